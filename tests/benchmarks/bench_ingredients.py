"""What each ingredient of the training schedule gains: the training without it, beside the training with all.

    python tests/benchmarks/bench_ingredients.py PLANT_DIR ... [--preset draft] [--only NAME ...] [--json FILE]

The plants must have been through the sfm stage; nothing is written into them. Prints a Markdown table a plant: held-out
PSNR of the full frame and of the plant region, CPU seconds of training (start included, loading and judging not), and
the number of Gaussians. What an ingredient gains is what is lost without it, at the time that is saved or spent.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from cotton3dg.files.colmap import read_points
from cotton3dg.options import PRESET_VALUES, PRESETS, TrainOptions, resolve
from cotton3dg.splat import densify, initialise, trainer
from cotton3dg.splat.metrics import view_quality
from cotton3dg.splat.views import View
from cotton3dg.stages.train import load_capture, load_windows
from cotton3dg.study.plant_region import PlantRegions
from cotton3dg.training.photos import Capture
from cotton3dg.workspace import Workspace


def at_full_size(views: list[View], steps: int) -> list[tuple[int, list[View]]]:
    return [(steps, views)]


def evenly(start: int, budget: int, progress: float) -> int:
    return start + round((budget - start) * progress)


def all_contribute(weight: Any, count: Any) -> Any:
    return np.ones(len(weight), bool)


def no_dense_points(views: Any, points: Any, count: int, seed: int) -> tuple[Any, Any]:
    return np.zeros((0, 3)), np.zeros((0, 3), np.uint8)


INGREDIENTS: dict[str, list[tuple[Any, str, Any]]] = {
    "coarse to fine": [(trainer, "resolutions", at_full_size)],
    "early splitting": [(densify, "scheduled_count", evenly)],
    "hidden ones pruned": [(densify, "find_contributing", all_contribute)],
    "plant first": [(trainer, "PLANT_NEED", 1.0)],
    "size limits": [(trainer, "LARGEST_IN_PLANT", np.inf), (trainer, "LARGEST_IN_ROOM", np.inf)],
    "rates for short runs": [(trainer, "PAPER_STEPS", 1)],
    "settling late": [(trainer, "SETTLING_FROM", 0.0), (trainer, "SETTLED", 0.25)],
    "longer steps far away": [(trainer, "SURROUNDINGS_GROWTH", 0.0)],
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


def trained(plant: Path, capture: Capture, options: TrainOptions) -> dict[str, float]:
    training = capture.training
    points, colours, _, _ = read_points(Workspace(plant).undistorted / "sparse")
    regions = PlantRegions().of_held_out(capture.views, options.holdout, points)
    began = time.process_time()
    start = initialise.start_gaussians(points, colours, training, options)
    result = trainer.fit(start, training, options, windows=load_windows(Workspace(plant), options, training))
    cpu_s = time.process_time() - began
    qualities = [
        view_quality(result.gaussians, view, region, gains)
        for view, region, gains in zip(capture.held_out, regions, capture.held_out_gains, strict=True)
    ]
    return {
        "psnr_db": float(np.mean([quality.psnr_db for quality in qualities])),
        "plant_psnr_db": float(np.nanmean([quality.plant_psnr_db for quality in qualities])),
        "cpu_s": cpu_s,
        "n_gaussians": len(result.gaussians),
    }


def variants(options: TrainOptions) -> dict[str, Callable[[Path, Capture], dict[str, float]]]:
    def without(name: str) -> Callable[[Path, Capture], dict[str, float]]:
        def run(plant: Path, capture: Capture) -> dict[str, float]:
            with ExitStack() as stack:
                for module, attribute, value in INGREDIENTS[name]:
                    stack.enter_context(patch.object(module, attribute, value))
                return trained(plant, capture, options)

        return run

    def changed(name: str) -> Callable[[Path, Capture], dict[str, float]]:
        values = {
            key: round(getattr(options, key) * value) if isinstance(value, float) else value
            for key, value in OPTIONS[name].items()
        }
        return lambda plant, capture: trained(plant, capture, resolve("train", vars(options), values))

    return (
        {"all": lambda plant, capture: trained(plant, capture, options)}
        | {f"without {name}": without(name) for name in INGREDIENTS}
        | {name: changed(name) for name in OPTIONS}
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plants", type=Path, nargs="+")
    parser.add_argument("--preset", choices=PRESETS, default="draft")
    parser.add_argument("--only", nargs="*", help="names of variants; default: every one")
    parser.add_argument("--json", type=Path, help="write the results here")
    arguments = parser.parse_args()
    options = resolve("train", PRESET_VALUES[arguments.preset].get("train", {}))
    names = variants(options).keys()
    if unknown := set(arguments.only or ()) - names:
        parser.error(f"no variant {', '.join(sorted(unknown))}; there are: {', '.join(names)}")
    results: dict[str, dict[str, dict[str, float]]] = {}
    for plant in arguments.plants:
        rows = results[plant.name] = {}
        capture = load_capture(Workspace(plant), options)
        print(f"\n{plant.name}\n\n| | PSNR, dB | plant, dB | CPU, s | Gaussians |\n|---|---|---|---|---|", flush=True)
        for name, run in variants(options).items():
            if arguments.only and name not in arguments.only:
                continue
            row = rows[name] = run(plant, capture)
            print(
                f"| {name} | {row['psnr_db']:.2f} | {row['plant_psnr_db']:.2f} | {row['cpu_s']:.0f} | "
                f"{row['n_gaussians']} |",
                flush=True,
            )
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
