# SPDX-License-Identifier: Apache-2.0
"""The simulated plant's skeleton: plants that bear as asked, and truth that agrees with their meshes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from cotton3dg.options import SimulateOptions
from cotton3dg.simulate.plant import PlantMeshes, grow_plant
from cotton3dg.simulate.truth import plant_truth

NATURAL = SimulateOptions(seed=7, architecture="natural", bolls=12)
SIMPLE = SimulateOptions(seed=3, bolls=4)
HARD = replace(NATURAL, vegetative=2, barren=0.25, broken=0.3, crossing=3, lean=12.0)


@cache
def grown(options: SimulateOptions) -> PlantMeshes:
    return grow_plant(options)


@pytest.mark.parametrize(
    ("options", "vertices", "sums"),
    [
        (SIMPLE, 62758, (-1134.7210529437746, 3936.6441786902246, 33254.286503545045)),
        (
            SimulateOptions(seed=5, bolls=14, clustered=0.6),
            181244,
            (6036.042359251254, -3213.727782245688, 95917.61937706517),
        ),
    ],
)
def test_simple_plants_stay_as_they_were_before_natural_ones_came(options, vertices, sums):
    plant = grown(options)
    assert len(plant.vertices) == vertices
    # Sines differ in their last bit from processor to processor; a nanometre is more than all of it.
    np.testing.assert_allclose(plant.vertices.mean(axis=0), np.divide(sums, vertices), rtol=0, atol=1e-9)


@pytest.mark.parametrize("options", [SIMPLE, HARD])
def test_axes_lie_in_the_wood_and_join(options):
    plant = grown(options)
    tree = cKDTree(plant.wood.vertices)
    for axis in plant.axes:
        assert len(axis.curve) == len(axis.radii)
        # The wood's surface is nowhere nearer or farther than the radius, but where the tube of another axis joins.
        away = tree.query(axis.curve[len(axis.curve) // 2 :])[0]
        above = axis.curve[len(axis.curve) // 2 :, 2] > 0.01
        assert np.median((away / axis.radii[len(axis.curve) // 2 :])[above]) == pytest.approx(1, abs=0.35)
        assert all(0 < node <= axis.stations[-1] + 1e-9 for node in axis.nodes)
        if axis.parent is not None:
            parent = plant.axes[axis.parent]
            assert cdist(axis.curve[:1], parent.curve).min() < 0.003
    stalks = [axis for axis in plant.axes if axis.kind == "peduncle"]
    for boll, stalk in zip(plant.bolls, stalks, strict=True):
        assert cdist(stalk.curve[-1:], boll.bur.vertices).min() < 0.01


def test_natural_plants_have_the_branches_that_are_asked_for():
    plain, hard = grown(NATURAL), grown(HARD)
    kinds = [[axis.kind for axis in plant.axes] for plant in (plain, hard)]
    assert [own.count("vegetative") for own in kinds] == [0, 2]
    assert min(own.count("fruiting") for own in kinds) >= 8
    bearing = {stalk.parent for stalk in hard.axes if stalk.kind == "peduncle"}
    fruiting = [number for number, axis in enumerate(hard.axes) if axis.kind == "fruiting"]
    assert len(bearing) < len(fruiting)
    leaning = grown(replace(NATURAL, lean=30.0))
    steps = [plant.axes[0].curve[12] - plant.axes[0].curve[0] for plant in (plain, leaning)]
    leans = [np.degrees(np.arctan2(np.linalg.norm(step[:2]), step[2])) for step in steps]
    assert leans[0] < 15 < leans[1]


def test_no_branch_bears_where_all_are_barren_and_none_is_cut_where_none_is_broken():
    assert not grown(replace(NATURAL, barren=1.0)).bolls
    whole, cut = (grown(replace(NATURAL, broken=share)) for share in (0.0, 1.0))
    lengths = [sum(axis.stations[-1] for axis in plant.axes if axis.kind == "fruiting") for plant in (whole, cut)]
    assert lengths[1] < 0.85 * lengths[0]


def test_crossing_branches_touch():
    def least_gap(plant: PlantMeshes) -> float:
        own = [axis.curve[len(axis.curve) // 3 :] for axis in plant.axes if axis.kind == "fruiting"]
        return min(cdist(a, b).min() for i, a in enumerate(own) for b in own[:i])

    seeds = range(3)
    apart = [least_gap(grown(replace(NATURAL, seed=seed))) for seed in seeds]
    crossed = [least_gap(grown(replace(NATURAL, seed=seed, crossing=4))) for seed in seeds]
    assert np.median(crossed) < 0.006
    assert np.median(apart) > np.median(crossed)


@pytest.mark.parametrize("seed", [625, 627, 633])
def test_branches_that_are_turned_reach_into_no_wood(seed):
    """Neither into the one that they touch, nor into the stem, nor into a third one."""

    def reached_into(plant: PlantMeshes) -> int:
        wood = [(axis.curve, axis.radii, axis.stations) for axis in plant.axes if axis.kind != "peduncle"]
        gaps = [
            (cdist(a[away > 0.02], b) - thick[away > 0.02, None] - its).min(initial=np.inf)
            for i, (a, thick, away) in enumerate(wood)
            for j, (b, its, _) in enumerate(wood)
            if i != j and i
        ]
        return sum(gap < 0 for gap in gaps)

    straight, crossed = (grown(replace(NATURAL, seed=seed, crossing=crossing)) for crossing in (0, 4))
    assert any((a.curve != b.curve).any() for a, b in zip(straight.axes, crossed.axes, strict=False))
    assert reached_into(crossed) <= reached_into(straight)


def test_truth_tells_the_branch_and_the_position_of_each_boll():
    plant = grown(HARD)
    truth = plant_truth(plant, HARD)
    axes = truth["skeleton"]
    assert [axis["id"] for axis in axes] == list(range(len(axes)))
    assert axes[0]["kind"] == "stem"
    assert axes[0]["parent"] is None
    for boll in truth["bolls"]:
        own = axes[boll["axis"]]
        assert own["kind"] == "fruiting"
        (stalk,) = [axis for axis in axes if axis["boll_id"] == boll["id"]]
        assert stalk["parent"] == boll["axis"]
        node = own["nodes_m"][boll["position"] - 1]
        points = np.array(own["points_m"])
        stations = np.append(0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
        place = [np.interp(node, stations, column) for column in points.T]
        assert np.linalg.norm(np.array(stalk["points_m"][0]) - place) < 0.002
    positions = [boll["position"] for boll in truth["bolls"]]
    assert positions.count(1) >= positions.count(3)


def test_a_simple_plant_states_no_fruiting_positions():
    # Its branches bear where no rule for cotton would look, so nothing may be judged by them.
    truth = plant_truth(grown(SIMPLE), SIMPLE)
    assert {boll["position"] for boll in truth["bolls"]} == {None}
    assert {len(axis["nodes_m"]) for axis in truth["skeleton"]} == {0}
    assert all(boll["axis"] is not None for boll in truth["bolls"])
