# SPDX-License-Identifier: Apache-2.0
"""How often two films of a plant are laid on each other rightly, and films of two plants wrongly.

    python tests/accuracy/two_films.py [--plants 24]

Simulated plants as their truth has them, simple and natural, with their maps and by their bolls alone. Each is seen
again turned at will, leaning by up to 3 degrees, its foot 0.5 cm beside the place, every place 0.4 cm off, and half of
its bolls picked; and each is laid on two other plants.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from markdown_tables import markdown

sys.path.insert(0, str(Path(__file__).parents[1]))

from scenes.filmed_scene import NO_MAP, filmed_again, leaning

from cotton3dg.core.plant_map import Axis, BollOnMap, PlantMap
from cotton3dg.evaluation.align import Alignment, Layout, align
from cotton3dg.options import resolve
from cotton3dg.simulate.plant import grow_plant

REACH_CM = 3.0


def true_layout(seed: int, architecture: str) -> Layout:
    """Bolls and map of a simulated plant in its plant frame, as the truth has them."""
    plant = grow_plant(resolve("simulate", {"seed": seed, "architecture": architecture}))
    wood = [axis for axis in plant.axes if axis.kind != "peduncle"]
    axes = tuple(
        Axis(rank, axis.kind, -1 if axis.parent is None else axis.parent, 100 * (axis.curve - plant.stem_base),
             100 * axis.radii, 1.0)
        for rank, axis in enumerate(wood)
    )  # fmt: skip
    centres = np.array([100 * (boll.lint.vertices.mean(axis=0) - plant.stem_base) for boll in plant.bolls])
    branch_of = tuple(int(axis.parent or 0) for axis in plant.axes[len(wood) :])
    sites = tuple(
        BollOnMap(number + 1, branch, 1, centres[number : number + 1], 0.0, 0, 1.0, 1.0)
        for number, branch in enumerate(branch_of)
    )
    return Layout(centres, branch_of, PlantMap(axes, sites))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plants", type=int, default=24)
    n = parser.parse_args().plants
    rows = []
    for architecture in ("simple", "natural"):
        plants = [true_layout(seed, architecture) for seed in range(n)]
        for mapped in (True, False):
            shown = plants if mapped else [Layout(p.centres_cm, (0,) * len(p.centres_cm), NO_MAP) for p in plants]
            rng = np.random.default_rng(0)
            right = wrong = mistaken = 0
            for seed, plant in enumerate(shown):
                bolls = len(plant.centres_cm)
                kept = np.sort(rng.choice(bolls, max(3, bolls // 2), replace=False))
                turn_deg = rng.uniform(-180, 180)
                rotation = leaning(turn_deg, rng.uniform(0, 3), rng.uniform(0, 360))
                again = filmed_again(plant, rotation, rng.normal(0, 0.5, 3), kept, noise_cm=0.4, seed=seed)
                found = align(plant, again, REACH_CM)
                if isinstance(found, Alignment):
                    near = abs((found.turn_deg - turn_deg + 180) % 360 - 180) < 5
                    right, wrong = right + near, wrong + (not near)
                others = (shown[(seed + 1) % n], shown[(seed + 5) % n])
                mistaken += sum(isinstance(align(plant, other, REACH_CM), Alignment) for other in others)
            row = {"plants": architecture, "by": "bolls and map" if mapped else "bolls"}
            row |= {"right": right, "wrong": wrong, "refused": n - right - wrong}
            rows.append(row | {f"of {2 * n} pairs of two plants": mistaken})
    print(markdown(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()
