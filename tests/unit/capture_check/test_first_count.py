# SPDX-License-Identifier: Apache-2.0
"""Bolls in space, from lines of sight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes.walked_film import BOLLS, DIAMETER, HEIGHT, WIDTH, sight_of

from cotton3dg.capture_check.first_count import find_bolls_in_space, find_sure
from cotton3dg.core.scene import Camera
from cotton3dg.geometry.camera_orbit import fit_orbit


def test_bolls_are_found_where_lines_of_sight_meet(cameras: list[Camera]) -> None:
    bolls = find_bolls_in_space([sight_of(camera) for camera in cameras], fit_orbit(cameras))
    far = np.linalg.norm(BOLLS[:, None] - np.stack([boll.centre for boll in bolls]), axis=2)
    assert len(bolls) == len(BOLLS) == len(find_sure(bolls, len(cameras)))
    assert far.min(axis=1).max() < 1e-6
    assert [boll.diameter_su for boll in bolls] == pytest.approx([DIAMETER] * 5, rel=0.05)


def test_bolls_that_some_images_hide_or_invent_are_still_counted_right(cameras: list[Camera]) -> None:
    rng = np.random.default_rng(0)
    sights = []
    for camera in cameras:
        sight = sight_of(camera)
        kept = rng.random(5) > 0.3
        invented = rng.uniform((0, 0), (WIDTH, HEIGHT), (2, 2))
        places = np.concatenate([sight.middles_px[kept] + rng.normal(0, 1, (kept.sum(), 2)), invented])
        sights.append(replace(sight, middles_px=places, diameters_px=np.append(sight.diameters_px[kept], [15.0, 15.0])))
    bolls = find_bolls_in_space(sights, fit_orbit(cameras))
    assert len(find_sure(bolls, len(cameras))) == 5


def test_images_without_bolls_give_none(cameras: list[Camera]) -> None:
    empty = [sight_of(camera, np.zeros((0, 3))) for camera in cameras]
    assert find_bolls_in_space(empty, fit_orbit(cameras)) == []


def test_photos_of_the_check_show_the_bolls_that_it_counts(cameras: list[Camera]) -> None:
    """Every image also shows something white that no other shows."""
    sights = []
    for number, camera in enumerate(cameras):
        sight = sight_of(camera)
        odd = np.array([[20.0 + 9 * number, 12.0]])
        sights.append(
            replace(
                sight,
                middles_px=np.concatenate([odd, sight.middles_px]),
                diameters_px=np.append(15.0, sight.diameters_px),
            )
        )
    counted = find_sure(find_bolls_in_space(sights, fit_orbit(cameras)), len(cameras))
    assert len(counted) == 5
    assert all(own > 1 for boll in counted for _, own in boll.seen)
    seen = [sorted(own for boll in counted for view, own in boll.seen if view == number) for number in range(24)]
    assert seen == 24 * [[2, 3, 4, 5, 6]]
