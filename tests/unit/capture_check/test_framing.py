# SPDX-License-Identifier: Apache-2.0
"""What the frame cuts, gaps in the walk, and corners that images show."""

from __future__ import annotations

import numpy as np
import pytest
from scenes.walked_film import BOLLS, DIAMETER, HEIGHT, WIDTH, camera_at, sight_of

from cotton3dg.capture_check.first_count import FoundBoll
from cotton3dg.capture_check.framing import corners_in_view, find_cut_plants, find_cut_sides, find_gaps
from cotton3dg.core.scene import Camera
from cotton3dg.geometry.camera_orbit import fit_orbit


def test_a_boll_at_the_edge_is_cut_by_that_side() -> None:
    low = camera_at(0, aim=-0.05)  # it looks down: the top of the plant leaves the frame
    bolls = [FoundBoll(centre, DIAMETER, 12) for centre in BOLLS]
    assert find_cut_sides(bolls, [low, camera_at(90)]) == {low.name: ("top",)}
    assert find_cut_sides([], [low]) == {}


def test_a_plant_that_no_image_shows_whole_is_told_by_its_looks(cameras: list[Camera]) -> None:
    stem, shelf = np.zeros((2, HEIGHT // 2, WIDTH // 2), np.int32)
    stem[: HEIGHT // 3, WIDTH // 4 - 15 : WIDTH // 4 + 15] = 1  # from the top down to where the bolls are
    shelf[:, :4] = 1  # brown, at the edge, and no part of the plant
    bolls = [FoundBoll(centre, DIAMETER, 12) for centre in BOLLS]
    assert find_cut_plants(bolls, [sight_of(cameras[0], plant=stem)]) == {cameras[0].name: ("top",)}
    assert find_cut_plants(bolls, [sight_of(cameras[0], plant=shelf)]) == {}


@pytest.mark.parametrize("direction", [1, -1])
def test_gaps_are_counted_along_the_walk(direction: int) -> None:
    walked = [camera_at(40 + direction * a) for a in (*range(0, 100, 5), *range(180, 330, 5))]
    gaps = find_gaps(walked, fit_orbit(walked), 20.0)
    assert [tuple(round(end) for end in gap) for gap in gaps] == [(95, 180), (325, 360)]


def test_corners_of_the_table_are_seen_or_not(cameras: list[Camera]) -> None:
    corners = np.array([[0, 0, 0.3], [0, 0, 9.0], [1.39, 0, 0.5]])
    assert corners_in_view(corners, cameras[:1]).tolist() == [1.0, 0.0, 1.0]
    assert corners_in_view(corners[2:], [camera_at(0), camera_at(90)]).tolist() == [0.5]
