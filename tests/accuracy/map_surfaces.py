# SPDX-License-Identifier: Apache-2.0
"""The plant map of simulated plants without filming them: places on the true surface of their wood, and the true bolls.

    python tests/accuracy/map_surfaces.py 5001 5024 [--crossing 2]

Natural plants of 14 bolls with the seeds from the first to the last, one in three without vegetative branches. Nothing
is missing or noisy, so what is wrong is the map's own way of joining places; a plant takes seconds, so many can be
looked at that nothing was settled with. Prints what all of them have right.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from pathlib import Path

import numpy as np
from map_budget import surface_places

from cotton3dg.evaluation.plant_map import MapScores, compare_maps, true_map
from cotton3dg.options import SimulateOptions
from cotton3dg.plant_map.map_plant import map_places
from cotton3dg.plant_map.wood import thinned
from cotton3dg.schemas.truth import Truth
from cotton3dg.simulate.plant import grow_plant
from cotton3dg.simulate.truth import plant_truth

SPACING_CM = 0.25


def options_of(seed: int, crossing: int) -> SimulateOptions:
    return SimulateOptions(
        seed=seed,
        architecture="natural",
        bolls=14,
        vegetative=seed % 3,
        barren=0.25,
        broken=0.15,
        crossing=crossing,
        lean=4 * (seed % 4),
    )


def truth_of(options: SimulateOptions) -> Truth:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "truth.json"
        path.write_text(json.dumps(plant_truth(grow_plant(options), options)), encoding="utf-8")
        return Truth.load(path)


def scores_of(truth: Truth) -> MapScores:
    base_m = np.array(truth.stem_base_xyz_m)
    places = thinned(surface_places(list(truth.skeleton), base_m), SPACING_CM)
    centres_cm = 100 * (np.array([boll.centre_xyz_m for boll in truth.bolls]).reshape(-1, 3) - base_m)
    bolls = [
        (number, centre, math.cbrt(6 / math.pi * boll.convex_volume_cm3))
        for number, (centre, boll) in enumerate(zip(centres_cm, truth.bolls, strict=True), start=1)
    ]
    ids, true = [number for number, _, _ in bolls], true_map(truth)
    assert true is not None
    return compare_maps(map_places(places, bolls), centres_cm, ids, true, centres_cm, truth.clamp_tube_height_cm)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--crossing", type=int, default=0, help="pairs of branches that are turned until they touch")
    wanted = parser.parse_args()
    seeds = range(wanted.first, wanted.last + 1)
    found = [scores_of(truth_of(options_of(seed, wanted.crossing))) for seed in seeds]

    def total(name: str) -> int:
        return sum(getattr(plant, name) for plant in found)

    f1 = 2 * total("matched_branches") / (total("true_branches") + total("measured_branches"))
    print(f"branches, F1     {f1:.3f}")
    print(f"on their branch  {total('bolls_on_branch')} of {total('bolls')}")
    print(f"position         {total('positions_right')} of {total('positions')}")
    print(f"length           {np.nanmean([plant.length_error_pct for plant in found]):.1f} %")
    print(f"internode        {np.nanmean([abs(plant.internode_error_pct) for plant in found]):.1f} %")


if __name__ == "__main__":
    main()
