# SPDX-License-Identifier: Apache-2.0
"""Which branch bears what, from ways whose order is known."""

import numpy as np
import pytest
from scenes.branch_scene import line, tube_places

from cotton3dg.plant_map.branching_order import base_angle_deg, draw_map, with_straight_base
from cotton3dg.plant_map.skeleton import RawAxis
from cotton3dg.plant_map.wood import BollBody, WoodCloud


def mapped_vegetative_branch(foot, touches=False):
    """The map of a stem and a rising branch that bears two others, each with a boll; a third boll at a foot either
    touches it or is its end."""
    outer = [] if touches else [(13, 0, 42), foot]
    stem, rising = line((0, 0, 0), (0, 0, 70)), line((0, 0, 14), (6, 0, 22), (9, 0, 40), *outer)
    ends = np.array([(14, 6, 34), (8, -9, 38), foot])
    ways = [RawAxis(stem, -1), RawAxis(rising, 0, 0 if touches else 3)]
    ways += [RawAxis(line((7, 0, 30), ends[0]), 1, 1), RawAxis(line((8, 0, 34), ends[1]), 1, 2)]
    if touches:
        ways.append(RawAxis(line(rising[-5], foot), 1, 3))
    return map_of_ways(ways, ends)


def map_of_ways(ways, ends):
    """The map of ways, of which some end at the feet of bolls 1, 2, ..."""
    bodies = tuple(BollBody(number, end + (1.0, 0, 2.0), 4.5, end) for number, end in enumerate(ends, 1))
    places = np.vstack([tube_places(way.curve, 0.2, np.random.default_rng(0)) for way in ways])
    n = len(places)
    cloud = WoodCloud(places, np.zeros(n, bool), np.zeros(n, np.int64), np.ones(n, bool), bodies)
    return draw_map(cloud, ways, 0.5)


def vegetative_and_bearer_of_3(found):
    (vegetative,) = [axis for axis in found.axes if axis.kind == "vegetative"]
    assert not vegetative.bolls
    return vegetative, found.axes[{boll.boll_id: boll.branch for boll in found.bolls}[3]]


def test_a_branch_with_two_bolls_of_its_own_is_fruiting_whatever_else_it_seems_to_bear():
    """Such as the outer part of a branch that touches it."""
    stem, rising = line((0, 0, 0), (0, 0, 70)), line((0, 0, 14), (6, 0, 22), (9, 0, 40))
    ends = np.array([(14, 6, 34), (9, 0, 40), (7.5, -1.5, 31)])
    ways = [RawAxis(stem, -1), RawAxis(rising, 0, 2), RawAxis(line((7, 0, 30), ends[0]), 1, 1)]
    ways.append(RawAxis(line((7.3, 0, 30), ends[2]), 1, 3))
    assert [axis.kind for axis in map_of_ways(ways, ends).axes] == ["stem", "fruiting", "fruiting"]


def test_a_rising_branch_that_bears_as_many_branches_as_bolls_is_vegetative():
    """Two of its own branches are there; of two that touch it only the bolls are told from it."""
    stem, rising = line((0, 0, 0), (0, 0, 70)), line((0, 0, 14), (6, 0, 22), (9, 0, 40))
    ends = np.array([(14, 6, 34), (8, -9, 38), (8.6, -2.5, 37), (6.5, 2.0, 27)])
    nodes = [(7, 0, 30), (8, 0, 34), (8.8, 0, 39), (6.7, 0, 26)]
    ways = [RawAxis(line(node, end), 1, number) for number, (node, end) in enumerate(zip(nodes, ends, strict=True), 1)]
    found = map_of_ways([RawAxis(stem, -1), RawAxis(rising, 0), *ways], ends)
    (vegetative,) = [axis for axis in found.axes if axis.kind == "vegetative"]
    assert not vegetative.bolls
    assert sum(len(axis.bolls) for axis in found.axes if axis.parent == vegetative.rank) == 4


def test_what_touches_the_tip_of_a_vegetative_branch_hangs_on_the_branch_beside():
    found = mapped_vegetative_branch(np.array([8.6, -2.5, 37.0]), touches=True)
    vegetative, branch = vegetative_and_bearer_of_3(found)
    assert (branch.kind, branch.parent) == ("fruiting", vegetative.rank)
    assert branch.bolls == (3, 2)
    assert branch.curve[-1] == pytest.approx([8, -9, 38], abs=0.1)


def test_a_vegetative_branch_that_ends_in_a_boll_has_its_last_branch_there():
    """What is left of it beyond that branch is too short to be seen; the branch bends again at its boll."""
    foot = np.array([13, 0, 46.0])
    found = mapped_vegetative_branch(foot)
    vegetative, branch = vegetative_and_bearer_of_3(found)
    assert (branch.kind, branch.parent, branch.bolls) == ("fruiting", vegetative.rank, (3,))
    assert branch.curve[0] == pytest.approx([9, 0, 40], abs=1)
    assert branch.curve[-1] == pytest.approx(foot, abs=0.1)
    assert vegetative.curve[-1] == pytest.approx(branch.curve[0], abs=0.5)
    assert [boll.position for boll in found.bolls] == [1, 1, 1]


@pytest.mark.parametrize("away_cm", [2.0, 6.0], ids=["hangs on it", "too far away"])
def test_a_boll_whose_foot_touches_the_stem_has_no_branch_there(away_cm):
    """It hangs on the branch beside, if there is one, and else on the stem itself."""
    stem, branch = line((0, 0, 0), (0, 0, 60)), line((0, 0, 34 - away_cm), (14, 0, 38 - away_cm))
    places = np.vstack([tube_places(curve, 0.2, np.random.default_rng(0)) for curve in (stem, branch)])
    foot = np.array([0.6, 0, 34.6])
    centre = foot + (0, 1.5, 1.7)
    ways = [RawAxis(stem, -1), RawAxis(branch, 0), RawAxis(line((0, 0, 34.5), foot), 0, boll=1)]
    n = len(places)
    bodies = (BollBody(7, centre, 4.5, foot),)
    found = draw_map(WoodCloud(places, np.zeros(n, bool), np.zeros(n, np.int64), np.ones(n, bool), bodies), ways, 0.5)
    assert [axis.rank for axis in found.axes] == [0, 1]
    (boll,) = found.bolls
    assert (boll.boll_id, boll.branch) == (7, 1 if away_cm == 2.0 else 0)
    assert found.axes[boll.branch].bolls == (7,)


def test_a_base_is_continued_to_the_middle_of_its_parent():
    parent = line((0, 0, 0), (0, 0, 40))
    # A shortest path climbs the stem's surface before it leaves it.
    curve = line((0.7, 0, 15), (0.7, 0, 19.3), (8.7, 0, 27.3), spacing=0.3)
    straight = with_straight_base(curve, parent, 0.7)
    assert straight[0] == pytest.approx([0, 0, 18.6], abs=0.15)
    assert base_angle_deg(straight, parent) == pytest.approx(45, abs=1.5)
