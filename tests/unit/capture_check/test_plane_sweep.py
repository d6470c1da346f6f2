# SPDX-License-Identifier: Apache-2.0
"""Places on planes at which photos agree."""

from __future__ import annotations

import numpy as np
import pytest
from scenes.walked_film import HEIGHT, WIDTH

from cotton3dg.capture_check.plane_sweep import find_agreeing_places
from cotton3dg.core.scene import Camera
from cotton3dg.geometry.camera_orbit import fit_orbit


def photos_of_a_pattern(cameras: list[Camera], rng: np.random.Generator) -> list[np.ndarray]:
    """A pattern painted on z = 0 within 0.4; what is around it is of another colour in each photo."""
    photos = []
    for camera in cameras:
        y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
        rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], -1)
        rays = rays @ camera.rotation
        with np.errstate(divide="ignore"):
            hit = camera.centre + rays * (-camera.centre[2] / rays[..., 2])[..., None]
        on = (np.abs(hit[..., :2]).max(axis=-1) < 0.4) & (rays[..., 2] < 0)
        pattern = 128 + 100 * np.sin(9 * hit[..., 0]) * np.sin(7 * hit[..., 1])
        grey = np.where(on, pattern, rng.uniform(0, 255))
        photos.append(np.repeat(grey[..., None], 3, axis=2).astype(np.uint8))
    return photos


def assert_the_pattern_is_covered(places: np.ndarray, cameras: list[Camera]) -> None:
    inside = (np.abs(places[:, :2]).max(axis=1) < 0.41) & (np.abs(places[:, 2]) < 0.003)
    expected = (0.8 / (0.02 * fit_orbit(cameras).radius)) ** 2
    assert inside.sum() == pytest.approx(expected, rel=0.15)


def test_photos_agree_on_the_plane_that_is_there(cameras: list[Camera]) -> None:
    rng = np.random.default_rng(1)
    photos = photos_of_a_pattern(cameras, rng)
    tracks = np.column_stack([rng.uniform(-0.4, 0.4, (300, 2)), np.zeros(300)])
    places = find_agreeing_places(tracks, fit_orbit(cameras), cameras, photos, 6.0)
    assert (np.abs(places[:, :2]).max(axis=1) < 0.41).mean() > 0.98
    assert_the_pattern_is_covered(places, cameras)


def test_a_bare_table_is_as_level_as_the_floor(cameras: list[Camera]) -> None:
    """Points on a sheet of paper and on a pot beside it lie on a plane as well, tilted by 14 degrees."""
    rng = np.random.default_rng(1)
    photos = photos_of_a_pattern(cameras, rng)
    paper = np.column_stack([rng.uniform(-0.08, 0.08, (60, 2)) + (0.2, 0), np.zeros(60)])
    pot = np.column_stack([rng.uniform(-0.04, 0.04, (60, 2)), np.full(60, 0.05)])
    floor = np.column_stack([rng.uniform(-2, 2, (600, 2)), np.full(600, -0.7)])
    places = find_agreeing_places(np.concatenate([paper, pot, floor]), fit_orbit(cameras), cameras, photos, 6.0)
    assert_the_pattern_is_covered(places, cameras)
