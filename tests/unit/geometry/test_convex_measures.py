# SPDX-License-Identifier: Apache-2.0
"""Volumes and diameters of bodies with a known answer."""

import numpy as np
import pytest

from cotton3dg.geometry.boxes import fibonacci_directions
from cotton3dg.geometry.convex_measures import alpha_volume, calliper_diameter, convex_volume

BOX = np.array([[x, y, z] for x in (0, 3) for y in (0, 2) for z in (0, 1)], float)
BALL = fibonacci_directions(2000)


def test_volume_of_a_box_and_of_a_ball():
    assert convex_volume(BOX) == (pytest.approx(6.0), "")
    assert convex_volume(BALL).value == pytest.approx(4 / 3 * np.pi, rel=0.005)


def test_hull_ignores_what_lies_inside():
    inside = np.random.default_rng(0).uniform([0, 0, 0], [3, 2, 1], (500, 3))
    assert convex_volume(np.vstack([BOX, inside])).value == pytest.approx(6.0)


def test_alpha_volume_of_a_hollow_ball_is_that_of_the_full_one():
    assert alpha_volume(BALL, 0.25).value == pytest.approx(convex_volume(BALL).value, rel=1e-6)


def test_alpha_volume_leaves_out_the_gap_between_two_balls():
    pair = np.vstack([BALL, BALL + [3.0, 0, 0]])
    two = 2 * convex_volume(BALL).value
    assert convex_volume(pair).value > 1.6 * two
    assert alpha_volume(pair, 0.25).value == pytest.approx(two, rel=0.02)


def test_alpha_volume_leaves_out_a_bay():
    cube = np.random.default_rng(0).uniform(0, 3, (12000, 3))
    horseshoe = cube[(cube[:, 0] <= 1) | (cube[:, 0] >= 2) | (cube[:, 1] <= 1)]
    assert convex_volume(horseshoe).value == pytest.approx(27.0, rel=0.05)
    assert alpha_volume(horseshoe, 0.3).value == pytest.approx(21.0, rel=0.08)
    assert alpha_volume(horseshoe, 50.0).value == pytest.approx(convex_volume(horseshoe).value, rel=1e-3)


def test_mean_calliper_width():
    # Of a convex body with edges: the sum of length times exterior angle over 4 pi; 1.5 sides for a cube.
    assert calliper_diameter(BOX).value == pytest.approx((3 + 2 + 1) * 4 * np.pi / 2 / (4 * np.pi), rel=0.003)
    assert calliper_diameter(2.5 * BALL).value == pytest.approx(5.0, rel=0.003)
