# SPDX-License-Identifier: Apache-2.0
"""Loops of wood where branches touch: opened where both go on straight."""

import numpy as np
import pytest
from scenes.branch_scene import line, tube_places
from scenes.touching_branches import MEETS, MEETS_OTHER, ONE, OTHER, STEM, assert_straight

from cotton3dg.geometry.polylines import length_of, nearest_on
from cotton3dg.plant_map.loops import open_loops
from cotton3dg.plant_map.skeleton import Meeting, RawAxis, extract_axes
from cotton3dg.plant_map.untangle import untangle_paths
from cotton3dg.plant_map.wood import classify

ASTRAY = np.vstack([ONE[:MEETS], OTHER[MEETS_OTHER:]])
"""The way that reaches the touch first goes on into the other branch."""
SHORT = MEETS_OTHER - 20
"""Row of `OTHER`, 5 cm before the touch, where the ways round the loop are equally long."""
BACK = OTHER[SHORT + 1 : MEETS_OTHER][::-1]
"""What is left in between is traced from the touch inwards."""


def link(one, other):
    return np.vstack([one, other])


@pytest.mark.parametrize("ends_with", ["nothing", "a boll"])
def test_a_loop_is_opened_where_its_branches_touch(ends_with):
    inner = OTHER[: SHORT + 1]
    if ends_with == "a boll":
        inner = np.vstack([inner, line(inner[-1], inner[-1] + (0, 0.5, 2.0), spacing=0.25)[1:]])
    ways = [
        RawAxis(STEM, -1),
        RawAxis(ASTRAY, 0, boll=3),
        RawAxis(inner, 0, boll=5 if ends_with == "a boll" else 0),
        RawAxis(ONE[MEETS:], 1, boll=4),
        RawAxis(BACK, 1),
        # A twig beyond the touch goes with the branch that bears it.
        RawAxis(line(OTHER[-12], OTHER[-12] + (0, 0, 3), spacing=0.25), 1),
    ]
    found = open_loops(ways, [Meeting(2, 4, link(OTHER[SHORT], BACK[-1]))])
    assert_straight([way for way in found if way.boll != 5])
    boll_of = {number: way for way in found for number in [way.boll] if number}
    assert nearest_on(OTHER, boll_of[3].curve)[0].max() < 0.6
    assert nearest_on(ONE, boll_of[4].curve)[0].max() < 0.6
    twig = next(way for way in found if abs(length_of(way.curve) - 3) < 0.3 and not way.boll)
    assert found[twig.parent] is boll_of[3]
    if ends_with == "a boll":
        assert found[boll_of[5].parent] is boll_of[3]
        assert length_of(boll_of[5].curve) < 3


@pytest.mark.parametrize(
    ("foot", "bearer"),
    [(ONE[MEETS - 5], 4), (ONE[MEETS + 5], 4), (OTHER[MEETS_OTHER - 5], 3), (OTHER[MEETS_OTHER + 5], 3)],
)
def test_a_stalk_at_a_touch_hangs_on_the_branch_that_it_begins_at(foot, bearer):
    """Bends do not tell, as stalks bend as they like."""
    ways = [
        RawAxis(STEM, -1),
        RawAxis(ASTRAY, 0, boll=3),
        RawAxis(OTHER[: SHORT + 1], 0),
        RawAxis(ONE[MEETS:], 1, boll=4),
        RawAxis(BACK, 1),
        RawAxis(line(foot, foot + (0, 0.3, 2.5), spacing=0.25), 1, boll=6),
    ]
    found = open_loops(ways, [Meeting(2, 4, link(OTHER[SHORT], BACK[-1]))])
    boll_of = {way.boll: way for way in found if way.boll}
    assert found[boll_of[6].parent] is boll_of[bearer]


def test_what_is_left_of_a_branch_beside_the_stem_leads_to_it():
    """Of a branch that touches another one soon, so little is left at its foot that it is no way."""
    foot, back = OTHER[:13], OTHER[13:MEETS_OTHER][::-1]
    ways = [RawAxis(STEM, -1), RawAxis(ASTRAY, 0, boll=3), RawAxis(ONE[MEETS:], 1, boll=4), RawAxis(back, 1)]
    found = open_loops(ways, [Meeting(0, 3, np.vstack([foot, back[-1:]]))])
    assert [way.parent for way in found] == [-1, 0, 0]
    boll_of = {way.boll: way for way in found}
    assert nearest_on(ONE, boll_of[4].curve)[0].max() < 0.6
    assert_straight(found)
    assert nearest_on(OTHER, boll_of[3].curve)[0].max() < 0.6


def test_branches_that_are_right_stay_as_they_are():
    """They touch, and a loop is closed there: it is open already."""
    scar = line(ONE[20], ONE[20] + (0, 0, 2), spacing=0.25)
    ways = [RawAxis(STEM, -1), RawAxis(ONE, 0, boll=1), RawAxis(OTHER, 0, boll=2), RawAxis(scar, 1)]
    assert open_loops(ways, []) is ways
    found = open_loops(ways, [Meeting(1, 2, link(ONE[MEETS], OTHER[MEETS_OTHER]))])
    assert all(one is other for one, other in zip(found, ways, strict=True))


def test_a_stub_that_nothing_goes_on_from_is_no_way():
    """Beside the stem something hangs that comes near to the tip of a branch, which ends there for good."""
    up = line((0, 0, 40), ONE[-1] + (0, 0, 0.8), spacing=0.25)
    ways = [RawAxis(STEM, -1), RawAxis(ONE, 0, boll=1)]
    found = open_loops(ways, [Meeting(0, 1, np.vstack([up, ONE[-2:-1]]))])
    assert len(found) == 2
    assert found[1].curve is ONE


def test_wood_of_two_branches_that_touch_gives_both():
    """From places on their surface: shortest paths go astray, the wood tells that it goes on, and both come out."""
    rng = np.random.default_rng(0)
    other = line((0, 0, 34), (16, 0.6, 19.6), spacing=0.25)
    places = np.vstack([tube_places(curve, 0.25, rng) for curve in (STEM, ONE, other)])
    ways, meetings = extract_axes(classify(places, []))
    assert meetings
    found = untangle_paths(open_loops(ways, meetings))
    for true in (ONE, other):
        likeness = [
            max(nearest_on(true, way.curve)[0].max(), nearest_on(way.curve, true)[0].max()) for way in found[1:]
        ]
        assert min(likeness) < 1.5


@pytest.mark.parametrize("seed", range(20))
def test_nothing_is_lost_whatever_meets(seed):
    """Random ways and meetings: what comes out hangs together at the stem and has every boll once."""
    rng = np.random.default_rng(seed)
    ways = [RawAxis(STEM, -1)]
    for number in range(1, 12):
        parent = int(rng.integers(0, len(ways))) if rng.random() < 0.5 else 0
        foot = ways[parent].curve[rng.integers(4, len(ways[parent].curve))]
        knots = foot + np.vstack([np.zeros(3), np.cumsum(rng.normal(0, 3, (2, 3)), axis=0)])
        ways.append(RawAxis(line(*knots, spacing=0.25), parent, boll=number * int(rng.random() < 0.6)))
    meetings = []
    for _ in range(4):
        one, other = sorted(rng.choice(12, 2, replace=False).tolist())
        places = [ways[way].curve[rng.integers(0, len(ways[way].curve))] for way in (one, other)]
        meetings.append(Meeting(one, other, line(*places, spacing=0.25)))
    found = open_loops(ways, meetings)
    assert sorted(way.boll for way in found if way.boll) == sorted(way.boll for way in ways if way.boll)
    assert found[0] is ways[0]
    for number, way in enumerate(found):
        assert np.isfinite(way.curve).all()
        chain = [number]
        while chain[-1]:
            chain.append(found[chain[-1]].parent)
            assert len(chain) <= len(found)
    total = sum(length_of(way.curve) for way in ways)
    assert sum(length_of(way.curve) for way in found) > 0.8 * total
