# SPDX-License-Identifier: Apache-2.0
"""Rectangles and boxes around sets of known shape."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cotton3dg.geometry.boxes import (
    fibonacci_directions,
    min_area_rectangle,
    nearly_least_rectangles,
    oriented_box,
    standing_box,
)


def test_rectangle_of_a_turned_rectangle():
    turn = Rotation.from_euler("z", 27, degrees=True).as_matrix()[:2, :2]
    points = np.random.default_rng(0).uniform([-6, -3], [6, 3], (400, 2))
    points = np.vstack([points, [[-6, -3], [6, -3], [6, 3], [-6, 3]]]) @ turn.T + [100, -50]
    box = min_area_rectangle(points)
    assert box.sides == pytest.approx([12, 6])
    assert box.centre == pytest.approx([100, -50])
    assert abs(box.axes[0] @ turn[:, 0]) == pytest.approx(1)
    assert not box.tie
    assert np.linalg.norm(box.corners[1] - box.corners[0]) == pytest.approx(12)
    assert np.linalg.norm(box.corners[2] - box.corners[1]) == pytest.approx(6)
    for corner in points[-4:]:
        assert np.linalg.norm(box.corners - corner, axis=1).min() < 1e-9


def test_rectangle_is_no_larger_than_any_other():
    points = np.random.default_rng(1).normal(size=(60, 2)) * [3, 1]
    angles = np.linspace(0, np.pi, 721)
    along = points @ np.stack([np.cos(angles), np.sin(angles)])
    across = points @ np.stack([-np.sin(angles), np.cos(angles)])
    assert np.prod(min_area_rectangle(points).sides) <= (np.ptp(along, axis=0) * np.ptp(across, axis=0)).min() + 1e-9


def test_nearly_least_rectangles():
    """Those on a triangle's sides are equally large; a corner below its base makes that one larger by 2.5 %."""
    leg = 20 * 2**0.5
    triangle = np.array([[-20, 0], [20, 0], [0, 20.0]])
    assert np.sort(nearly_least_rectangles(triangle, 1e-9).max(axis=1)) == pytest.approx([leg, leg, 40])
    kite = np.vstack([triangle, [0, -0.5]])
    assert nearly_least_rectangles(kite, 0.01) == pytest.approx(np.full((2, 2), leg))
    assert np.sort(nearly_least_rectangles(kite, 0.03).max(axis=1)) == pytest.approx([leg, leg, 40, 40], rel=0.001)
    assert nearly_least_rectangles(np.ones((1, 2)), 0.1).tolist() == [[0, 0]]


def test_oriented_box_of_a_turned_box():
    turn = Rotation.from_euler("xyz", (20, 40, 60), degrees=True).as_matrix()
    corners = np.array([[x, y, z] for x in (-5, 5) for y in (-2, 2) for z in (-1, 1)], float)
    box = oriented_box(corners @ turn.T + [7, 8, 9])
    assert box.sides == pytest.approx([10, 4, 2])
    assert box.centre == pytest.approx([7, 8, 9])
    assert abs(box.axes[0] @ turn[:, 0]) == pytest.approx(1)
    assert np.linalg.det(box.axes) == pytest.approx(1)


def test_dense_parts_do_not_turn_the_box():
    corners = np.array([[x, y, z] for x in (-5, 5) for y in (-2, 2) for z in (-1, 1)], float)
    crowd = np.random.default_rng(2).uniform([2, 0, 0], [4.9, 1.9, 0.9], (5000, 3))
    assert oriented_box(np.vstack([corners, crowd])).sides == pytest.approx([10, 4, 2])


def test_directions_are_unit_and_balanced():
    directions = fibonacci_directions(200)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(np.ones(200))
    assert directions.T @ directions / 200 == pytest.approx(np.eye(3) / 3, abs=0.01)


def test_a_box_needs_points():
    for points in (np.zeros((0, 3)), np.zeros((4, 2)), np.full((3, 3), np.nan)):
        with pytest.raises(ValueError, match="finite points"):
            oriented_box(points)


def test_a_flat_set_of_many_points_has_a_box_along_its_rim():
    """100,000 points of a 6 x 4 table, half of them in one corner, turned in space."""
    rng = np.random.default_rng(7)
    flat = np.vstack(
        [rng.uniform(-1, 1, (50_000, 2)), rng.uniform(0.8, 1, (50_000, 2)), [[x, y] for x in (-1, 1) for y in (-1, 1)]]
    )
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    box = oriented_box(np.column_stack([3 * flat[:, 0], 2 * flat[:, 1], np.zeros(len(flat))]) @ turn.T)
    assert box.sides == pytest.approx([6, 4, 0], rel=1e-3, abs=1e-9)


def test_a_frayed_corner_does_not_turn_the_standing_box():
    """Three corners of a table and many points around where the fourth was: the rim is where the rectangle lies."""
    angles = np.linspace(0, np.pi / 2, 60)
    rounded = np.column_stack([2 + np.cos(angles), 1 + np.sin(angles), np.full(60, 0.02)])
    cloud = np.vstack([rounded, [[-3, -2, 0], [3, -2, 0], [-3, 2, 0]]])
    turn = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    box = standing_box(cloud @ turn.T)
    assert box.sides == pytest.approx([6, 4, 0.02])
    assert abs(box.axes[0] @ turn[:, 0]) == pytest.approx(1)
    assert abs(oriented_box(cloud @ turn.T).axes[0] @ turn[:, 0]) != pytest.approx(1, abs=1e-3)
