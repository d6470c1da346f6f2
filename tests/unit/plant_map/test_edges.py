# SPDX-License-Identifier: Apache-2.0
"""Where wood ends: colours of half-covered pixels by hand, and as a model shows them."""

from dataclasses import fields

import numpy as np
import pytest
from scenes.boll_scene import cameras

from cotton3dg.core.scene import SH_CONSTANT, Gaussians
from cotton3dg.plant_map.edges import HALF, edge_opacity, opacity_at_half


def coloured(size: float, value: float) -> Gaussians:
    """One solid ball at the origin, of one colour from all sides."""
    return Gaussians(
        np.zeros((1, 3), np.float32),
        np.float32([[1, 0, 0, 0]]),
        np.full((1, 3), np.log(size), np.float32),
        np.float32([8.0]),
        np.full((1, 1, 3), (value - 0.5) / SH_CONSTANT, np.float32),
    )


def evenly(value: float) -> np.ndarray:
    return np.full((4, 3), value, np.float32)


@pytest.mark.parametrize(("front", "behind", "opacity"), [
    # Half of white's light is 0.735 in sRGB.
    (0.0, 1.0, 1 - 0.7354),
    (1.0, 0.0, 0.7354),
    # Linear light 0.0331 and 0.3185: half is 0.1758, which is 0.4563.
    (0.2, 0.6, (0.6 - 0.4563) / 0.4),
    # Nothing is to be seen of this edge.
    (0.50, 0.52, HALF),
])  # fmt: skip
def test_opacity_of_a_half_covered_pixel(front, behind, opacity):
    assert opacity_at_half(evenly(front), evenly(behind)) == pytest.approx(opacity, abs=1e-3)


def test_strong_edges_count_most():
    front = np.vstack([evenly(0.2), evenly(0.2)])
    behind = np.vstack([evenly(0.6), evenly(0.22)])
    assert opacity_at_half(front, behind) == pytest.approx((0.6 - 0.4563) / 0.4, abs=1e-2)


def test_no_pixels_and_no_cameras_tell_nothing():
    assert opacity_at_half(np.zeros((0, 3)), np.zeros((0, 3))) == HALF
    wood, wall = coloured(0.02, 0.2), coloured(50.0, 0.6)
    assert edge_opacity(wood, wall, []) == HALF
    assert edge_opacity(wood[:0], wall, cameras()) == HALF


def test_a_model_shows_its_own_colours():
    assert edge_opacity(coloured(0.05, 0.2), coloured(0.5, 0.6), cameras()) == pytest.approx(
        (0.6 - 0.4563) / 0.4, abs=0.005
    )


@pytest.mark.parametrize("damaged", ["means", "quats", "log_scales", "opacity_logits", "sh"])
def test_damaged_gaussians_change_nothing(damaged):
    def beside_nan(sound):
        arrays = {field.name: np.repeat(getattr(sound, field.name), 2, axis=0) for field in fields(sound)}
        arrays[damaged][1] = np.nan
        return Gaussians(**arrays)

    wood, wall = coloured(0.05, 0.2), coloured(0.5, 0.6)
    expected = edge_opacity(wood, wall, cameras())
    assert edge_opacity(beside_nan(wood), wall, cameras()) == expected
    assert edge_opacity(wood, beside_nan(wall), cameras()) == expected
