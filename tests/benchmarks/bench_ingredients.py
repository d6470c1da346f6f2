# SPDX-License-Identifier: Apache-2.0
"""What each ingredient of the training schedule gains: the training without it, beside the training with all.

    python tests/benchmarks/bench_ingredients.py PLANT_DIR ... [--preset draft] [--only NAME ...] [--json FILE]
        [--equal-time] [--seeds 0 1 2]

The plants must have been through the sfm stage; nothing is written into them. Prints a Markdown table a plant: held-out
PSNR of the full frame and of the plant region, CPU seconds of training (start included, loading and judging not), and
the number of Gaussians; means over the seeds. What an ingredient gains is what is lost without it, at the time that is
saved or spent; `--equal-time`: at the time of the training with all. A variant then gets the number of steps that takes
as long, known from a training with the first seed, unless that took as long to a twentieth anyway.
"""

from __future__ import annotations

import argparse
import json
import time
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from cotton3dg.gaussians.metrics import view_quality
from cotton3dg.gaussians.views import View
from cotton3dg.io.colmap import read_points
from cotton3dg.options import PRESET_VALUES, PRESETS, TrainOptions, resolve
from cotton3dg.study.plant_region import PlantRegions
from cotton3dg.train import densify, initialise, schedule, trainer
from cotton3dg.train.photos import Capture
from cotton3dg.train.stage import load_capture, load_windows
from cotton3dg.workspace import Workspace


def at_full_size(views: list[View], steps: int) -> list[tuple[int, list[View]]]:
    return [(steps, views)]


def evenly(start: int, budget: int, progress: float) -> int:
    return start + round((budget - start) * progress)


def all_contribute(weight: Any, count: Any) -> Any:
    return np.ones(len(weight), bool)


def as_they_come(means: Any) -> Any:
    return np.arange(len(means))


def no_dense_points(views: Any, points: Any, count: int, seed: int) -> tuple[Any, Any]:
    return np.zeros((0, 3)), np.zeros((0, 3), np.uint8)


INGREDIENTS: dict[str, list[tuple[Any, str, Any]]] = {
    "coarse to fine": [(schedule, "resolutions", at_full_size)],
    "settled early": [(schedule, "DENSIFY_UNTIL", 0.6)],
    "early splitting": [(densify, "scheduled_count", evenly)],
    "order along a curve": [(densify, "order_along_curve", as_they_come)],
    "hidden ones pruned": [(densify, "find_contributing", all_contribute)],
    "plant first": [(trainer, "PLANT_NEED", 1.0)],
    "size limits": [(trainer, "LARGEST_IN_PLANT", np.inf), (trainer, "LARGEST_IN_ROOM", np.inf)],
    "rates for short runs": [(schedule, "PAPER_STEPS", 1)],
    "settling late": [(schedule, "SETTLING_FROM", 0.0), (schedule, "SETTLED", 0.25)],
    "longer steps far away": [(schedule, "SURROUNDINGS_GROWTH", 0.0)],
    "dense points from flow": [(initialise, "find_dense_points", no_dense_points)],
    "filling of the plant region": [(initialise, "FILL_SHARE", 0.0)],
    "opaque start": [(initialise, "START_OPACITY", 0.1)],
}
"""Name -> what replaces it."""

OPTIONS: dict[str, dict[str, Any]] = {
    "whole images": {"plant_window": False},
    "SH degree 0": {"sh_degree": 0},
    "SH degree 1": {"sh_degree": 1},
    "half the budget": {"max_gaussians": 0.5},
    "twice the budget": {"max_gaussians": 2.0},
    "half the steps": {"steps": 0.5},
    "twice the steps": {"steps": 2.0},
}
"""Name -> option and its value, or factor where it is a float."""


AS_LONG = 0.05
"""Trainings whose times differ by no more of the one with all take as long."""

Row = dict[str, float]


@dataclass(frozen=True)
class Plant:
    """What all variants of a plant's training share."""

    workspace: Workspace
    capture: Capture
    points: NDArray
    colours: NDArray
    regions: list[NDArray]
    """Of each held-out image, what is judged as the plant."""

    @staticmethod
    def load(folder: Path, options: TrainOptions) -> Plant:
        workspace = Workspace(folder)
        capture = load_capture(workspace, options)
        points, colours, _, _ = read_points(workspace.undistorted / "sparse")
        regions = PlantRegions().of_held_out(capture.views, options.holdout, points)
        return Plant(workspace, capture, points, colours, regions)


def trained(plant: Plant, options: TrainOptions) -> Row:
    training = plant.capture.training
    began = time.process_time()
    start = initialise.start_gaussians(plant.points, plant.colours, training, options)
    result = trainer.fit(start, training, options, windows=load_windows(plant.workspace, options, training))
    cpu_s = time.process_time() - began
    qualities = [
        view_quality(result.gaussians, view, region, gains)
        for view, region, gains in zip(plant.capture.held_out, plant.regions, plant.capture.held_out_gains, strict=True)
    ]
    return {
        "psnr_db": float(np.mean([quality.psnr_db for quality in qualities])),
        "plant_psnr_db": float(np.nanmean([quality.plant_psnr_db for quality in qualities])),
        "cpu_s": cpu_s,
        "n_gaussians": len(result.gaussians),
    }


def variant(name: str, plant: Plant, options: TrainOptions) -> Row:
    """The results of one variant of a training."""
    if name in OPTIONS:
        values = {
            key: round(getattr(options, key) * value) if isinstance(value, float) else value
            for key, value in OPTIONS[name].items()
        }
        return trained(plant, resolve("train", vars(options), values))
    with ExitStack() as stack:
        for module, attribute, value in INGREDIENTS.get(name.removeprefix("without "), []):
            stack.enter_context(patch.object(module, attribute, value))
        return trained(plant, options)


def main() -> None:
    names = ["all", *(f"without {name}" for name in INGREDIENTS), *OPTIONS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plants", type=Path, nargs="+")
    parser.add_argument("--preset", choices=PRESETS, default="draft")
    parser.add_argument("--only", nargs="*", help="names of variants; default: every one")
    parser.add_argument("--equal-time", action="store_true", help="each variant takes as long as the training with all")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--json", type=Path, help="write the results here")
    arguments = parser.parse_args()
    if unknown := set(arguments.only or ()) - set(names):
        parser.error(f"no variant {', '.join(sorted(unknown))}; there are: {', '.join(names)}")
    if arguments.only:
        # What takes as long as all has to know how long that takes.
        names = [name for name in names if name in arguments.only or (name == "all" and arguments.equal_time)]
    base = resolve("train", PRESET_VALUES[arguments.preset].get("train", {}))
    results: dict[str, dict[str, list[Row]]] = {}
    for folder in arguments.plants:
        rows = results[folder.name] = {}
        plant = Plant.load(folder, base)
        print(f"\n{folder.name}\n\n| | PSNR, dB | plant, dB | CPU, s | Gaussians |\n|---|---|---|---|---|", flush=True)
        for name in names:
            options, seeds = base, arguments.seeds
            rows[name] = [variant(name, plant, replace(options, seed=seeds[0]))]
            if arguments.equal_time and name != "all":
                share = float(np.mean([row["cpu_s"] for row in rows["all"]])) / rows[name][0]["cpu_s"]
                if abs(share - 1) > AS_LONG:
                    options = replace(base, steps=max(1, round(share * base.steps)))
                    rows[name] = [variant(name, plant, replace(options, seed=seeds[0]))]
            rows[name] += [variant(name, plant, replace(options, seed=seed)) for seed in seeds[1:]]
            psnr, plant_psnr, cpu, n = (float(np.mean([row[key] for row in rows[name]])) for key in rows[name][0])
            print(f"| {name} | {psnr:.2f} | {plant_psnr:.2f} | {cpu:.0f} | {n:.0f} |", flush=True)
            if arguments.json:
                arguments.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
