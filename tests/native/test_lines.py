# SPDX-License-Identifier: Apache-2.0
"""What photos show along thin lines, beside the same in numpy."""

from __future__ import annotations

from typing import Any

import numpy as np
import photo_lines
import pytest

from cotton3dg import _native
from cotton3dg.core.scene import Camera
from cotton3dg.gaussians.rasterizer import view_of

CAMERAS = [
    Camera("a", 60, 40, 50.0, 55.0, 30.0, 20.0, np.eye(4)[:3]),
    Camera("b", 33, 70, 40.0, 40.0, 15.0, 36.0, np.array([[0.8, 0, -0.6, 0.5], [0, 1, 0, 0.1], [0.6, 0, 0.8, 0.2]])),
]
MODEL = {"aside_px": (2.5, 3.5), "noise": 3.5, "colour_share": 0.35}


def pictures(rng: np.random.Generator) -> list[np.ndarray]:
    found = [rng.integers(0, 256, (camera.height, camera.width, 4), np.uint8) for camera in CAMERAS]
    for picture in found:
        picture[..., 3] = 0
        picture[5:9, 10:24, 3] = 255
    return found


def evidence(seen: list[np.ndarray], *lines: Any, threads: int = 1, **model: Any) -> tuple[np.ndarray, np.ndarray]:
    views = [view_of(camera, 1e-9) for camera in CAMERAS]
    return _native.line_evidence(seen, views, *lines, threads=threads, **{**MODEL, **model})


def some_lines(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Also at the photos' rims, outside of them and behind the cameras."""
    places = rng.normal([0, 0, 1], [0.5, 0.4, 0.7], (count, 3))
    return places, rng.normal(size=(count, 3)), rng.uniform(0, 255, (len(CAMERAS), 3))


@pytest.mark.parametrize("aside_px", [(2.5, 3.5), (1.0,)])
def test_it_is_what_numpy_computes(aside_px) -> None:
    rng = np.random.default_rng(0)
    seen, lines = pictures(rng), some_lines(rng, 5000)
    above, below = evidence(seen, *lines, aside_px=aside_px)
    expected = photo_lines.line_evidence(seen, CAMERAS, *lines, aside_px, MODEL["noise"], MODEL["colour_share"])
    assert ((expected[1] > 0).mean(axis=1) > 0.1).all() and ((expected[1] > 0).mean(axis=1) < 0.7).all()
    np.testing.assert_array_equal(below > 0, expected[1] > 0)
    # The twin takes directions from two places near each other, so its own error is the larger one.
    np.testing.assert_allclose(above, expected[0], atol=1e-4)
    np.testing.assert_allclose(below, expected[1], atol=1e-4)


def test_threads_change_no_bit() -> None:
    rng = np.random.default_rng(1)
    seen, lines = pictures(rng), some_lines(rng, 500)
    for one, other in zip(evidence(seen, *lines), evidence(seen, *lines, threads=0), strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_last_pixels_are_seen_and_nothing_beyond() -> None:
    """A level line is judged while its sides, 3.5 px above and below it, lie between the middles of the outer rows."""
    seen = [np.full((camera.height, camera.width, 4), (90, 80, 70, 0), np.uint8) for camera in CAMERAS]
    rows = np.array([4.0, 4.01, 35.99, 36.0])  # those middles are at 0.5 and 39.5
    places = np.array([[0.0, (row - 20) / 55, 1.0] for row in rows])
    _, below = evidence(seen, places, np.repeat([[1.0, 0, 0]], 4, axis=0), np.zeros((2, 3)))
    assert (below[0] > 0).tolist() == [True, True, True, True]
    places[:, 1] = (np.array([3.99, 3.5, 36.01, 36.5]) - 20) / 55
    _, below = evidence(seen, places, np.repeat([[1.0, 0, 0]], 4, axis=0), np.zeros((2, 3)))
    assert not below[0].any()


def test_no_lines_have_no_evidence() -> None:
    none = np.zeros((0, 3))
    above, below = evidence(pictures(np.random.default_rng(2)), none, none, np.zeros((2, 3)))
    assert above.shape == below.shape == (2, 0)


@pytest.mark.parametrize("spoilt", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_is_no_place_is_not_seen(spoilt, axis) -> None:
    places, directions, colours = some_lines(np.random.default_rng(3), 1)
    places[0, axis] = spoilt
    above, below = evidence(pictures(np.random.default_rng(3)), places, directions, colours)
    assert not above.any() and not below.any()


def test_what_does_not_fit_is_refused() -> None:
    rng = np.random.default_rng(4)
    seen, (places, directions, colours) = pictures(rng), some_lines(rng, 3)
    with pytest.raises(ValueError, match="directions must have the shape"):
        evidence(seen, places, directions[:2], colours)
    with pytest.raises(ValueError, match="colours must have the shape"):
        evidence(seen, places, directions, colours[:1])
    with pytest.raises(ValueError, match="picture must have the shape"):
        evidence(seen[::-1], places, directions, colours)
    with pytest.raises(ValueError, match="needs its view"):
        evidence(seen[:1], places, directions, colours)
    with pytest.raises(TypeError, match="uint8"):
        evidence([picture.astype(np.float32) for picture in seen], places, directions, colours)
    with pytest.raises(ValueError, match="positive"):
        evidence(seen, places, directions, colours, aside_px=())
