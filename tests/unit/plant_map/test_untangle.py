# SPDX-License-Identifier: Apache-2.0
"""Ways that shortest paths led astray: what goes on straight belongs together."""

import numpy as np
import pytest
from scenes.branch_scene import line
from scenes.touching_branches import MEETS, MEETS_OTHER, ONE, OTHER, STEM, assert_straight

from cotton3dg.geometry.polylines import length_of, nearest_on
from cotton3dg.plant_map.skeleton import RawAxis
from cotton3dg.plant_map.untangle import untangle_paths

SIDE = line(ONE[30], ONE[30] + (3, 9, 1), spacing=0.25)
TIP = ONE[30:42]
"""3 cm, straight on from where the side branch leaves."""


@pytest.mark.parametrize("other_half", ["is a way of its own", "leaves the touch as a child"])
def test_what_touches_is_paired_anew(other_half):
    astray = np.vstack([ONE[:MEETS], OTHER[MEETS_OTHER:]])
    ways = [RawAxis(STEM, -1), RawAxis(astray, 0, boll=3), RawAxis(OTHER[:MEETS_OTHER], 0)]
    if other_half == "leaves the touch as a child":
        ways.append(RawAxis(ONE[MEETS:], 1, boll=4))
        # A twig beyond the touch goes with the branch that bears it.
        ways.append(RawAxis(line(OTHER[-12], OTHER[-12] + (0, 0, 3), spacing=0.25), 1))
        found = untangle_paths(ways)
        assert_straight(found)
        owner = next(way for way in found if np.linalg.norm(way.curve[0] - OTHER[0]) < 0.5)
        twig = next(way for way in found if length_of(way.curve) < 3.5)
        assert found[twig.parent] is owner
        assert owner.boll == 3
        assert [way.boll for way in found if np.linalg.norm(way.curve[0] - ONE[0]) < 0.5] == [4]
    else:
        found = untangle_paths(ways)
        (own,) = [way for way in found[1:] if np.linalg.norm(way.curve[0] - OTHER[0]) < 0.5]
        assert nearest_on(OTHER, own.curve)[0].max() < 0.6
        assert own.boll == 3


def test_at_a_fork_the_straight_part_goes_on():
    """The longest way takes the side branch first: the branch itself left it as a child."""
    ways = [RawAxis(STEM, -1), RawAxis(np.vstack([ONE[:30], SIDE]), 0, boll=1), RawAxis(ONE[30:], 1, boll=2)]
    found = untangle_paths(ways)
    assert len(found) == 3
    assert nearest_on(ONE, found[1].curve)[0].max() < 0.6
    assert [way.boll for way in found] == [0, 2, 1]
    assert [way.parent for way in found] == [-1, 0, 1]


@pytest.mark.parametrize("bare_cm", [np.inf, 2.5])
def test_a_short_tip_that_goes_on_straight_is_the_end_of_its_branch(bare_cm):
    """The last side branch is longer than what is left of the branch, and the longest way took it."""
    tip = RawAxis(TIP, 1, bare_cm=bare_cm)
    found = untangle_paths([RawAxis(STEM, -1), RawAxis(np.vstack([ONE[:30], SIDE]), 0, boll=1), tip])
    assert length_of(found[1].curve) == pytest.approx(length_of(ONE[:42]), abs=0.6)
    assert nearest_on(ONE, found[1].curve)[0].max() < 0.3
    assert (found[1].parent, found[1].boll) == (0, 0)
    assert (found[2].parent, found[2].boll) == (1, 1)


@pytest.mark.parametrize(
    "child",
    [
        RawAxis(TIP, 1, boll=2),
        RawAxis(TIP, 1, bare_cm=1.0),
        RawAxis(TIP[:7], 1),
        # No straighter than the way as it is.
        RawAxis(line(ONE[30], ONE[30] + (1.0, -2.6, 0.3), spacing=0.25), 1),
    ],
    ids=["stalk", "leaf", "scar", "bent"],
)
def test_what_may_bend_as_it_likes_is_no_end_of_a_branch(child):
    ways = [RawAxis(STEM, -1), RawAxis(np.vstack([ONE[:30], SIDE]), 0, boll=1), child]
    found = untangle_paths(ways)
    assert found[1].boll == 1
    assert found[1].curve is ways[1].curve


def test_a_leaf_and_its_stalk_take_nothing_over():
    """The stalk goes on straighter than the branch, which bends at its node."""
    bent = np.vstack([ONE[:30], line(ONE[30], ONE[30] + (5, 6, 2), spacing=0.25)])
    ways = [RawAxis(STEM, -1), RawAxis(bent, 0, boll=1), RawAxis(ONE[30:], 1, bare_cm=4.0)]
    found = untangle_paths(ways)
    assert found[1].curve.tobytes() == bent.tobytes()
    assert found[2].curve.tobytes() == ONE[30:].tobytes()


def test_branches_that_are_right_stay_to_the_bit():
    scar = line(ONE[20], ONE[20] + (0, 0, 2), spacing=0.25)
    ways = [RawAxis(STEM, -1), RawAxis(ONE, 0, boll=1), RawAxis(SIDE, 1, boll=2), RawAxis(scar, 1), RawAxis(OTHER, 0)]
    for way, own in zip(untangle_paths(ways), ways, strict=True):
        assert way.curve.tobytes() == own.curve.tobytes()
        assert (way.parent, way.boll) == (own.parent, own.boll)


@pytest.mark.parametrize("up_cm", [0.0, 20.0])
def test_what_would_leave_a_fruiting_branch_as_a_branch_is_another_branch_s(up_cm):
    """Branches bend at nodes, here by 45 degrees where they touch; vegetative ones, low on the stem, bear others."""
    up = np.array([0, 0, up_cm])
    node = OTHER[MEETS_OTHER]
    outer = line(node, node + (8, 3, 0.5), spacing=0.25)
    ways = [RawAxis(STEM, -1), RawAxis(ONE + up, 0, boll=1), RawAxis(OTHER[:MEETS_OTHER] + up, 0)]
    ways.append(RawAxis(outer + up, 1, boll=2))
    found = untangle_paths(ways)
    if up_cm:
        assert [way.parent for way in found] == [-1, 0, 0]
        assert [way.boll for way in found] == [0, 1, 2]
        assert nearest_on(found[2].curve, (outer + up)[4:])[0].max() < 0.3
    else:
        assert [way.parent for way in found] == [-1, 0, 0, 1]
