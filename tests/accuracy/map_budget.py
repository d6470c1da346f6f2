# SPDX-License-Identifier: Apache-2.0
"""Which step the plant map loses what by: true facts take the place of measured ones, one after another.

    python tests/accuracy/map_budget.py RUN[:TRUTH] [RUN[:TRUTH] ...]

The runs are finished plants of `cotton3dg simulate --architecture natural` (study_set.py --natural makes twelve). Rows:

- measured: what the run says
- true bolls: map of the run's model, the bolls are the true ones
- true wood: besides, only places beside a true stem, branch or stalk are wood
- true ways: besides, the skeleton has the true ways, moved to the middle of the model's wood; what is left is order,
  kind, position and length
- surface: places on the true surface, evenly and whole, instead of the model's: what better wood could gain

Scores as study_set.py --natural prints them; means over the plants at the end, of the branches' F1 over all branches.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
import pandas as pd
from markdown_tables import markdown
from numpy.typing import NDArray
from study_set import map_columns
from true_scene import TruePlant, cm_from_scene, true_plant

from cotton3dg.core.plant_map import PlantMap
from cotton3dg.evaluation.plant_map import MapScores, compare_maps, evaluate_map, true_map
from cotton3dg.geometry.polylines import nearest_on
from cotton3dg.io.ply import read_gaussians
from cotton3dg.plant_map.branching_order import draw_map
from cotton3dg.plant_map.map_plant import BollPlace, map_places
from cotton3dg.plant_map.skeleton import (
    CENTRE_REACH_CM,
    SMOOTHING,
    STEM_REACH_CM,
    STEM_SMOOTHING,
    RawAxis,
    centred,
    stem_radius,
)
from cotton3dg.plant_map.wood import classify, wood_places
from cotton3dg.schemas.truth import TrueAxis, Truth

BESIDE_CM = 0.3
"""How far from a true surface the model's wood may lie."""
PER_CM2 = 6.0
"""Places on the true surface."""


def curve_cm(axis: TrueAxis, base_m: NDArray) -> NDArray[np.float64]:
    """(N, 3) in the plant frame, turned as the true world is."""
    return 100 * (np.array(axis.points_m, np.float64) - base_m)


def model_places(plant: TruePlant, base_m: NDArray) -> NDArray[np.float64]:
    """(N, 3) cm, places along the model's Gaussians of the plant without its bolls', where the truth has the plant."""
    run = plant.run
    gaussians = read_gaussians(run.gaussians_ply)
    wood = np.load(run.plant_npy) & (np.load(run.labels_npy) == 0)
    similarity = cm_from_scene(plant)
    foot = np.linalg.solve(similarity[:, :3], 100 * base_m - similarity[:, 3])
    return wood_places(gaussians[wood], similarity[:, :3], foot)


def surface_places(axes: list[TrueAxis], base_m: NDArray) -> NDArray[np.float64]:
    """(N, 3) cm, places on the tubes of the true wood."""
    rng, places = np.random.default_rng(0), []
    for axis in axes:
        curve, radii = curve_cm(axis, base_m), 0.1 * np.array(axis.radius_mm)
        lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1)))
        at = rng.uniform(0, lengths[-1], int(np.ceil(2 * np.pi * radii.mean() * lengths[-1] * PER_CM2)))
        middles = np.column_stack([np.interp(at, lengths, values) for values in curve.T])
        along = np.column_stack([np.interp(at, lengths, values) for values in np.gradient(curve, axis=0).T])
        across = np.cross(along, rng.normal(size=along.shape))
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        places.append(middles + np.interp(at, lengths, radii)[:, None] * across)
    return np.vstack(places)


def near_wood(places: NDArray, axes: list[TrueAxis], base_m: NDArray) -> NDArray[np.bool_]:
    """(N,) whether a place lies beside the true surface of some wood."""
    near = np.zeros(len(places), bool)
    for axis in axes:
        reach = 0.1 * max(axis.radius_mm) + BESIDE_CM
        near |= nearest_on(curve_cm(axis, base_m), places, reach)[0] < reach
    return near


def map_of_true_ways(places: NDArray, bolls: list[BollPlace], true: PlantMap) -> PlantMap:
    """The map that the order makes of the true ways: stem, branches to their last boll, stalks of the others."""
    cloud = classify(places, bolls)
    wood = places[cloud.bur == 0]
    ends = {axis.rank: axis.curve[-1] for axis in true.branches}
    last = {boll.branch: boll.boll_id for boll in true.bolls if np.array_equal(boll.stalk[-1], ends.get(boll.branch))}
    raw = []
    for axis in true.axes:
        reach, smoothing = (STEM_REACH_CM, STEM_SMOOTHING) if axis.kind == "stem" else (CENTRE_REACH_CM, SMOOTHING)
        raw.append(RawAxis(centred(axis.curve, wood, reach, smoothing), axis.parent, last.get(axis.rank, 0)))
    raw += [
        RawAxis(boll.stalk, boll.branch, boll.boll_id) for boll in true.bolls if last.get(boll.branch) != boll.boll_id
    ]
    return draw_map(cloud, raw, stem_radius(raw[0].curve, places))


def budget(plant: TruePlant) -> Iterator[tuple[str, MapScores]]:
    """The scores with more and more truth.

    Raises:
        BadInput: the truth has no skeleton.
    """
    truth_json = plant.truth / "truth.json"
    truth = Truth.load(truth_json)
    true, measured = true_map(truth), evaluate_map(plant.run, truth_json)
    if true is None or measured is None:
        raise SystemExit(f"{truth_json} has no skeleton; film the plant with --architecture natural")
    base_m = np.array(truth.stem_base_xyz_m, np.float64)
    axes = list(truth.skeleton)
    centres = 100 * (np.array([boll.centre_xyz_m for boll in truth.bolls]).reshape(-1, 3) - base_m)
    diameters = np.cbrt(6 / np.pi * np.array([boll.convex_volume_cm3 for boll in truth.bolls]))
    bolls = [(n, centre, float(size)) for n, (centre, size) in enumerate(zip(centres, diameters, strict=True), start=1)]
    ids = [boll_id for boll_id, _, _ in bolls]

    def scored(plant_map: PlantMap) -> MapScores:
        return compare_maps(plant_map, centres, ids, true, centres, truth.clamp_tube_height_cm)

    places = model_places(plant, base_m)
    wood = places[near_wood(places, axes, base_m)]
    yield "measured", measured
    yield "true bolls", scored(map_places(places, bolls))
    yield "true wood", scored(map_places(wood, bolls))
    yield "true ways", scored(map_of_true_ways(wood, bolls, true))
    yield "surface", scored(map_places(surface_places(axes, base_m), bolls))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plants", nargs="+", type=true_plant, metavar="RUN[:TRUTH]")
    rows = []
    for plant in parser.parse_args().plants:
        for step, scores in budget(plant):
            counts = {"true": scores.true_branches, "found": scores.measured_branches, "right": scores.matched_branches}
            rows.append({"plant": plant.run.plant_id, "with": step, **counts, **map_columns(scores)})
    table = pd.DataFrame(rows)
    print(markdown(table.drop(columns="branch_f1")))
    steps = table.drop(columns="plant").set_index("with").abs().groupby(level=0, sort=False)
    means, sums = steps.mean(), steps[["true", "found", "right"]].sum()
    means["branch_f1"] = 2 * sums["right"] / (sums["true"] + sums["found"])
    print(f"Means of absolute errors:\n\n{markdown(means.drop(columns=['true', 'found', 'right']).reset_index(), 3)}")


if __name__ == "__main__":
    main()
