# SPDX-License-Identifier: Apache-2.0
"""The way of a camera that pans over a known picture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from cotton3dg.frames.camera_travel import WayMeter

WIDTH, HEIGHT = 320, 180


def panorama(width: int = 4000) -> np.ndarray:
    """(HEIGHT, width) grey blobs of all sizes."""
    rng = np.random.default_rng(0)
    layers = [cv2.resize(rng.random((HEIGHT // s, width // s), np.float32), (width, HEIGHT)) for s in (4, 16, 45)]
    return (np.mean(layers, axis=0) * 255).astype(np.uint8)


def ways_of(offsets: np.ndarray) -> np.ndarray:
    """What the meter says of a camera that pans by whole pixels."""
    wide, meter = panorama(), WayMeter()
    return np.array([meter.add(np.ascontiguousarray(wide[:, x : x + WIDTH])) for x in offsets])


def test_the_way_is_that_of_the_picture() -> None:
    ways = ways_of(np.arange(0, 1600, 5))
    np.testing.assert_allclose(ways, np.arange(0, 1600, 5) / WIDTH, atol=0.03 * 1600 / WIDTH)


def test_a_hand_that_trembles_does_not_get_anywhere() -> None:
    trembling = 40 + np.random.default_rng(1).integers(-3, 4, 300)
    assert ways_of(trembling)[-1] < 8 / WIDTH


def test_a_covered_lens_goes_on_as_before() -> None:
    wide, meter = panorama(), WayMeter()
    for k in range(40):
        frame = np.ascontiguousarray(wide[:, 6 * k : 6 * k + WIDTH])
        meter.add(np.zeros_like(frame) if 18 <= k < 22 else frame)
    assert meter.way == pytest.approx(39 * 6 / WIDTH, rel=0.25)
