"""The plant map from places of wood: known tubes give known branches, angles, lengths, sites and thickness."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scenes.branch_scene import branch_scene, bur_places, line, tube_places

from cotton3dg.core.plant_map import PlantMap
from cotton3dg.core.scene import Gaussians
from cotton3dg.geometry.polylines import (
    length_of,
    nearest_on,
    path_lengths,
    place_at,
    resampled,
    smoothed,
)
from cotton3dg.plant_map.branching_order import base_angle_deg, draw_map, with_straight_base
from cotton3dg.plant_map.graph import joined, shortest_paths
from cotton3dg.plant_map.map_plant import map_cloud, map_places
from cotton3dg.plant_map.radii import radii_of
from cotton3dg.plant_map.skeleton import FEWEST_PLACES, RawAxis, bare_length, extract_axes
from cotton3dg.plant_map.summary import boll_rows, branch_rows, summarise_map
from cotton3dg.plant_map.wood import BollBody, WoodCloud, thinned


@cache
def mapped() -> PlantMap:
    scene = branch_scene()
    return map_places(thinned(scene.places, 0.25), scene.bolls)


@pytest.mark.parametrize("n", [FEWEST_PLACES - 1, FEWEST_PLACES])
def test_a_handful_of_places_has_no_stem(n):
    places = np.column_stack([np.zeros((n, 2)), np.arange(n, dtype=float)])
    cloud = WoodCloud(places, np.zeros(n, bool), np.zeros(n, np.int64), np.ones(n, bool), ())
    axes, _ = extract_axes(cloud)
    assert len(axes) == (n >= FEWEST_PLACES)


def test_lengths_and_places_along_a_polyline():
    points = np.array([[0, 0, 0], [3, 0, 0], [3, 4, 0.0]])
    assert path_lengths(points).tolist() == [0, 3, 7]
    assert place_at(points, 5.0) == pytest.approx([3, 2, 0])
    away, station = nearest_on(points, np.array([[1, 1, 0], [5, 4, 0.0]]))
    assert away == pytest.approx([1, 2])
    assert station == pytest.approx([1, 7])
    places = np.random.default_rng(0).uniform(-3, 7, (500, 3))
    (away, station), (near, its_station) = nearest_on(points, places), nearest_on(points, places, 2.0)
    assert (near[away < 2] == away[away < 2]).all() and (its_station[away < 2] == station[away < 2]).all()
    assert (near[away >= 2] >= 2).all() and np.isinf(near).any()
    even = resampled(points, 0.5)
    assert np.allclose(np.linalg.norm(np.diff(even, axis=0), axis=1), 0.5)
    assert smoothed(even, 2.0)[[0, -1]] == pytest.approx(even[[0, -1]])


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


def test_a_blade_that_ends_thinly_begins_where_its_stalk_ends():
    """A way ran along a leaf's rim twice, and two places lay past its tip: as half of it was no blade, the whole leaf
    was the lowest branch."""
    curve = line((0, 0, 0), (12.8, 0, 0))
    places = [(x, 0, 0) for x in np.arange(0.05, 6, 0.1)]
    for start, beside in zip(range(6, 12), (0.9, 0.6, 0.3, 0.9, 0.7, 0.3), strict=True):
        across = np.where(np.arange(50) < 50 * beside, 1.0, 0.0)
        places += [(start + (k + 0.5) / 50, y, 0) for k, y in enumerate(across)]
    places += [(12.2, 0, 0), (12.4, 0, 0)]
    assert bare_length(curve, np.array(places)) == 6.0
    assert bare_length(curve, np.array(places[:60])) == np.inf, "nothing but a stalk"


def test_parts_are_joined_with_the_nearest_of_others_whatever_their_size():
    rng = np.random.default_rng(3)
    crowd = rng.normal(0, 0.4, (150, 3))
    spots = np.array([[5, 0, 0], [5.5, 0, 0], [9, 0, 0], [0, 30, 0.0]])
    places = np.vstack([crowd, spots])
    pairs = {tuple(pair) for pair in joined(places).pairs}
    nearest = int(np.argmin(np.linalg.norm(crowd - spots[0], axis=1)))
    assert (nearest, 150) in pairs
    assert (151, 152) in pairs
    assert not any(153 in pair for pair in pairs), "too far for a bridge"


def test_shortest_paths_go_around_what_is_dear_and_through_no_foot():
    straight = np.column_stack([np.zeros(21), np.zeros(21), np.arange(21) * 0.5])
    feet = np.array([[0.4, 0, 5.0]])
    tree = shortest_paths(joined(straight), np.zeros(21, bool), 0, feet)
    assert tree.lengths[20] == pytest.approx(10)
    assert tree.before[21] in (9, 10, 11)
    assert 21 not in tree.before


def test_a_base_is_continued_to_the_middle_of_its_parent():
    parent = line((0, 0, 0), (0, 0, 40))
    # A shortest path climbs the stem's surface before it leaves it.
    curve = line((0.7, 0, 15), (0.7, 0, 19.3), (8.7, 0, 27.3), spacing=0.3)
    straight = with_straight_base(curve, parent, 0.7)
    assert straight[0] == pytest.approx([0, 0, 18.6], abs=0.15)
    assert base_angle_deg(straight, parent) == pytest.approx(45, abs=1.5)


@pytest.mark.parametrize("opaque", [0.5, 0.36])
@pytest.mark.parametrize("radius", [0.75, 0.2])
def test_thickness_is_that_of_the_silhouette(radius, opaque):
    opacity = 0.9
    # One long needle falls to an opacity at its width over sqrt(2 ln (its own / that)).
    sigma = radius / np.sqrt(2 * np.log(opacity / opaque))
    gaussians = Gaussians(
        np.float32([[0, 0, 10]]),
        np.float32([[1, 0, 0, 0]]),
        np.log(np.float32([[sigma, sigma, 300]])),
        np.float32([np.log(opacity / (1 - opacity))]),
        np.zeros((1, 1, 3), np.float32),
    )
    (radii,) = radii_of([line((0, 0, 9.2), (0, 0, 10.8))], gaussians, np.eye(3), np.zeros(3), opaque)
    assert np.nanmedian(radii) == pytest.approx(radius, abs=0.01)


def test_no_gaussians_have_no_thickness():
    none = Gaussians(*(np.zeros(shape, np.float32) for shape in ((0, 3), (0, 4), (0, 3), (0,), (0, 1, 3))))
    (radii,) = radii_of([line((0, 0, 0), (0, 0, 10))], none, np.eye(3), np.zeros(3), 0.5)
    assert np.isnan(radii).all()
