# SPDX-License-Identifier: Apache-2.0
"""The plant map from places of wood: known tubes give known branches, angles, lengths and sites."""

from dataclasses import replace

import numpy as np
import pytest
from scenes.branch_scene import branch_scene, bur_places, line, mapped, tube_places

from cotton3dg.core.plant_map import PlantMap
from cotton3dg.geometry.polylines import length_of, nearest_on, place_at
from cotton3dg.plant_map.branching_order import base_angle_deg
from cotton3dg.plant_map.map_plant import map_cloud, map_places
from cotton3dg.plant_map.summary import boll_rows, branch_rows, summarise_map
from cotton3dg.plant_map.wood import thinned


def test_branches_are_those_that_grew():
    scene, found = branch_scene(), mapped()
    assert [axis.kind for axis in found.axes] == ["stem"] + 5 * ["fruiting"]
    assert nearest_on(scene.stem, found.stem.curve)[0].max() < 0.4
    for axis, true in zip(found.branches, scene.branches, strict=True):
        assert axis.parent == 0
        assert axis.curve[0] == pytest.approx(true[0], abs=0.4)
        assert base_angle_deg(axis.curve, found.stem.curve) == pytest.approx(base_angle_deg(true, scene.stem), abs=5)
        assert nearest_on(true, axis.curve[4:-8])[0].max() < 0.35
        assert axis.confidence > 0.95
    barren = found.branches[1]
    assert length_of(barren.curve) == pytest.approx(length_of(scene.branches[1]), rel=0.05)


def test_each_boll_sits_on_its_branch_at_its_position():
    found = mapped()
    assert [(boll.branch, boll.rank, boll.position) for boll in found.bolls] == [
        (1, 1, 1),
        (1, 2, 2),
        (3, 1, 1),
        (4, 1, 1),
    ]
    for boll, node in zip(found.bolls, (9, 15, 7, 5), strict=True):
        assert boll.path_cm == pytest.approx(node, abs=1.7)
    assert found.branches[0].bolls == (1, 2)


def test_the_same_places_give_the_same_map():
    scene, found = branch_scene(), mapped()
    again = map_places(thinned(scene.places, 0.25), scene.bolls)
    for one, other in zip(found.axes, again.axes, strict=True):
        assert one.curve.tobytes() == other.curve.tobytes()


def test_traits_of_the_map():
    found = mapped()
    traits = summarise_map(found, 4.0, 0.002, 0.1)
    assert traits.branch_count == traits.fruiting_branch_count == 5
    assert traits.bearing_branch_count == 3
    assert traits.first_fruiting_branch_height_cm == pytest.approx(20, abs=0.4)
    assert traits.internode_mean_cm == pytest.approx(8.0, abs=0.15)
    assert traits.stem_length_cm == pytest.approx(60, abs=1.0)
    assert traits.stem_lean_deg < 1
    assert traits.bolls_by_branch == (2, 0, 1, 1, 0)
    assert traits.bolls_by_position == (3, 1, 0)
    assert traits.first_position_share_pct == 75
    assert np.isnan(traits.stem_diameter_mm)
    # One branch in eleven may be missing or none, whatever scale and pixels err by.
    exact = summarise_map(found, 4.0, 0.0, 0.0)
    assert exact.branch_count_error == pytest.approx(0.3 * 5**0.5, rel=0.05)
    assert exact.internode_mean_error_cm == pytest.approx(8.0 * 0.3 * 5**0.5 / 4, rel=0.02)
    assert exact.branch_length_mean_error_cm > 0.2 * exact.branch_length_mean_cm / 5**0.5
    assert exact.branch_angle_mean_error_deg == pytest.approx(9 / 5**0.5)
    assert exact.first_fruiting_branch_height_error_cm == pytest.approx(0.4)
    assert exact.stem_length_error_cm == 0
    borne = summarise_map(replace(found, axes=(replace(found.stem, bolls=(9,)), *found.branches)), 4.0, 0.0, 0.0)
    assert borne.stem_length_error_cm == 2.0
    rows = branch_rows(found)
    assert [row.branch for row in rows] == [1, 2, 3, 4, 5]
    assert rows[0].boll_ids == (1, 2)
    assert rows[1].reach_cm < rows[1].length_cm
    assert boll_rows(found)[3].branch == 3


def test_a_gap_behind_a_boll_is_bridged():
    scene = branch_scene()
    hole = np.linalg.norm(scene.places - place_at(scene.branches[1], 6.0), axis=1) > 1.2
    found = map_places(thinned(scene.places[hole], 0.25), scene.bolls)
    assert len(found.branches) == 5
    assert length_of(found.branches[1].curve) == pytest.approx(length_of(scene.branches[1]), rel=0.06)
    assert found.branches[1].confidence < 1


@pytest.mark.parametrize(
    "places",
    [
        np.zeros((0, 3)),
        np.zeros((50, 3)),
        np.random.default_rng(0).normal(0, 2, (300, 3)),
        np.linspace((0, 0, 5), (0, 0, 9), 100),
    ],
    ids=["nothing", "one place", "a heap", "a stump"],
)
def test_without_a_stem_there_is_no_map_but_a_reason(places):
    found = map_places(places, [(1, np.zeros(3), 4.5), (2, np.full(3, np.nan), np.nan)])
    if not found.axes:
        assert found.reason == "no_stem"
    assert summarise_map(PlantMap((), (), "no_stem"), 4.0, 0.0, 0.1).branch_count is None


def test_a_bare_stem_has_no_branches():
    stem = tube_places(line((0, 0, 5), (0, 0, 50)), 0.6, np.random.default_rng(0), 60)
    found = map_cloud(stem, [])
    assert found.branches == ()
    traits = summarise_map(found, 4.0, 0.0, 0.1)
    assert traits.branch_count == 0
    assert np.isnan(traits.first_fruiting_branch_height_cm)
    assert traits.stem_diameter_mm == pytest.approx(12, abs=0.6)


UP = np.array([0.2, -0.1, 1.0]) / np.linalg.norm([0.2, -0.1, 1.0])


def hung_boll(node, stalk_cm, rng):
    """A stalk's and bur's places, and the boll's middle."""
    foot = node + stalk_cm * UP
    bur, centre = bur_places(foot, UP, rng)
    return [tube_places(line(node, foot), 0.18, rng), bur], centre


def test_bolls_on_a_vegetative_branch_hang_on_branches_of_its_own():
    """One of them so short that on a fruiting branch it would be a stalk."""
    rng = np.random.default_rng(0)
    stem, rising = line((0, 0, 0), (0, 0, 70)), line((0, 0, 14), (6, 0, 22), (9, 0, 46))
    long_one, short_one = rising[180] + (7, 6, 4), rising[260] + (-0.5, -3.0, 1.0)
    curves = [stem[60:], rising, line(rising[180], long_one), line(rising[260], short_one)]
    places = [tube_places(curve, radius, rng, 60) for curve, radius in zip(curves, (0.7, 0.35, 0.2, 0.2), strict=True)]
    bolls = []
    for tip in (long_one, short_one):
        own, centre = hung_boll(tip, 1.2, rng)
        places += own
        bolls.append((len(bolls) + 1, centre, 4.5))
    found = map_places(thinned(np.vstack(places), 0.25), bolls)
    (vegetative,) = [axis for axis in found.axes if axis.kind == "vegetative"]
    own = [axis for axis in found.branches if axis.parent == vegetative.rank]
    assert [axis.bolls for axis in sorted(own, key=lambda axis: axis.curve[0, 2])] == [(1,), (2,)]
    assert not vegetative.bolls
    assert {boll.boll_id: boll.branch for boll in found.bolls} == {axis.bolls[0]: axis.rank for axis in own}


@pytest.mark.parametrize(("foot_cm", "branches"), [(14.0, 4), (45.0, 2)], ids=["vegetative", "fruiting"])
def test_fruiting_branches_bear_no_branches(foot_cm, branches):
    """What leaves one and bears nothing is a leaf's stalk, a scar or the wood of another."""
    rng = np.random.default_rng(0)
    foot = np.array([0, 0, foot_cm])
    branch = line(foot, foot + (6, 0, 8), foot + (11, 0, 24))
    twigs = [line(branch[at], branch[at] + way) for at, way in ((120, (5, 4, 3)), (190, (4, -4.5, 2)))]
    curves = [line((0, 0, 0), (0, 0, 75))[60:], branch, line((0, 0, 35), (-9, 4, 42)), *twigs]
    places = [
        tube_places(curve, radius, rng, 60) for curve, radius in zip(curves, (0.7, 0.35, *3 * [0.2]), strict=True)
    ]
    found = map_places(thinned(np.vstack(places), 0.25), [])
    assert len(found.branches) == branches
    assert {axis.parent for axis in found.branches if axis.kind == "fruiting"} <= {
        axis.rank for axis in found.axes if axis.kind != "fruiting"
    }


def test_a_stem_that_bends_low_does_not_go_on_into_a_higher_branch():
    """The sharpest bend lies on what the ways to both tips have in common."""
    rng = np.random.default_rng(0)
    stem = line((0, 0, 0), (0, 0, 20), (12, 0, 34), (14, 0, 60))
    foot = stem[np.argmin(np.abs(stem[:, 2] - 50))]
    branch = line(foot, foot + (11, 0, 12))
    places = np.vstack([tube_places(stem[60:], 0.5, rng, 60), tube_places(branch, 0.2, rng, 60)])
    found = map_places(thinned(places, 0.25), [])
    assert found.stem.curve[-1] == pytest.approx(stem[-1], abs=1)
    assert [axis.parent for axis in found.branches] == [0]


def test_a_branch_with_a_boll_and_bare_twigs_is_fruiting():
    """Twigs without a boll on a branch with bolls of its own are what hangs about these: dry bracts, a bur's valves."""
    rng = np.random.default_rng(0)
    branch = line((0, 0, 14), (6, 0, 22), (11, 0, 38))
    twigs = [line(branch[at], branch[at] + way) for at, way in ((120, (5, 4, 3)), (190, (4, -4.5, 2)))]
    curves = [line((0, 0, 0), (0, 0, 75))[60:], branch, line((0, 0, 35), (-9, 4, 42)), *twigs]
    places = [
        tube_places(curve, radius, rng, 60) for curve, radius in zip(curves, (0.7, 0.35, *3 * [0.2]), strict=True)
    ]
    own, centre = hung_boll(branch[240], 1.2, rng)
    found = map_places(thinned(np.vstack([*places, *own]), 0.25), [(1, centre, 4.5)])
    assert [axis.kind for axis in found.axes] == ["stem", "fruiting", "fruiting"]
    assert found.axes[1].bolls == (1,)


def test_what_bolls_hang_on_is_no_leaf():
    """Dry bracts about the end of a branch looked like a blade, which took in the twig beside it."""
    rng = np.random.default_rng(0)
    branch = line((0, 0, 25), (20, 0, 34))
    twig = line(branch[100], (14, 3.2, 32))
    own, centre = hung_boll(branch[150], 1.0, rng)
    its, its_centre = hung_boll(twig[-1], 1.0, rng)
    bracts = branch[rng.integers(110, len(branch), 250)] + rng.uniform(-1.3, 1.3, (250, 3))
    curves = (line((0, 0, 5), (0, 0, 60)), branch, twig)
    tubes = [tube_places(curve, radius, rng, 60) for curve, radius in zip(curves, (0.7, 0.2, 0.2), strict=True)]
    places = thinned(np.vstack([*tubes, *own, *its, bracts]), 0.25)
    found = map_places(places, [(1, centre, 4.5), (2, its_centre, 4.5)])
    assert [axis.bolls for axis in found.branches] == [(1,), (2,)]
    assert nearest_on(found.branches[1].curve, twig)[0].max() < 0.5
