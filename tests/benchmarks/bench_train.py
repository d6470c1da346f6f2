# SPDX-License-Identifier: Apache-2.0
"""Time to quality of the train stage: held-out PSNR against training time, as JSON on standard output.

    python tests/benchmarks/bench_train.py PLANT_DIR [--preset draft] [--set steps=1000 ...] [--every 500]

PLANT_DIR must have been through the sfm stage; nothing is written into it. The clock stops while a model is judged.
`cpu_seconds` counts all threads: divide by the number of cores for the time on an otherwise idle machine.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

from cotton3dg.core.scene import Gaussians
from cotton3dg.gaussians.metrics import view_quality
from cotton3dg.io.colmap import read_points
from cotton3dg.option_rules import as_dict
from cotton3dg.options import PRESET_VALUES, PRESETS, resolve
from cotton3dg.study.plant_region import PlantRegions
from cotton3dg.train.initialise import start_gaussians
from cotton3dg.train.stage import load_capture, load_windows
from cotton3dg.train.trainer import fit
from cotton3dg.workspace import Workspace


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plant", type=Path)
    parser.add_argument("--preset", choices=PRESETS, default="standard")
    parser.add_argument("--set", nargs="*", default=[], metavar="OPTION=VALUE")
    parser.add_argument("--every", type=int, default=500, help="steps between two judgements")
    arguments = parser.parse_args()
    chosen = dict(pair.split("=", 1) for pair in arguments.set)
    options = resolve("train", PRESET_VALUES[arguments.preset].get("train", {}), chosen)

    workspace = Workspace(arguments.plant)
    began, cpu_began = time.perf_counter(), time.process_time()
    capture = load_capture(workspace, options)
    training, held_out = capture.training, capture.held_out
    points, colours, _, _ = read_points(workspace.undistorted / "sparse")
    loaded, cpu_loaded = time.perf_counter(), time.process_time()
    start = start_gaussians(points, colours, training, options)
    started, cpu_started = time.perf_counter(), time.process_time()
    regions = PlantRegions().of_held_out(capture.views, options.holdout, points)
    curve: list[dict[str, float]] = []
    judging = cpu_judging = 0.0

    def watch(step: int, gaussians: Gaussians) -> None:
        if step % arguments.every == 0 and step != options.steps:
            judge(step, gaussians)

    def judge(step: int, gaussians: Gaussians) -> None:
        nonlocal judging, cpu_judging
        now, cpu_now = time.perf_counter(), time.process_time()
        qualities = [
            view_quality(gaussians, view, region, gains)
            for view, region, gains in zip(held_out, regions, capture.held_out_gains, strict=True)
        ]
        curve.append(
            {
                "step": step,
                "seconds": round(now - started - judging, 2),
                "cpu_seconds": round(cpu_now - cpu_started - cpu_judging, 2),
                "n_gaussians": len(gaussians),
                "psnr_db": round(float(np.mean([quality.psnr_db for quality in qualities])), 3),
                "plant_psnr_db": round(float(np.nanmean([quality.plant_psnr_db for quality in qualities])), 3),
                "ssim": round(float(np.mean([quality.ssim for quality in qualities])), 4),
            }
        )
        print(curve[-1], file=sys.stderr)
        judging += time.perf_counter() - now
        cpu_judging += time.process_time() - cpu_now

    windows = load_windows(workspace, options, training)
    judge(options.steps, fit(start, training, options, watch=watch, windows=windows).gaussians)
    print(
        json.dumps(
            {
                "plant": workspace.plant_id,
                "options": as_dict(options),
                "n_training": len(training),
                "n_held_out": len(held_out),
                "load_cpu_seconds": round(cpu_loaded - cpu_began, 2),
                "load_seconds": round(loaded - began, 2),
                "start_cpu_seconds": round(cpu_started - cpu_loaded, 2),
                "start_seconds": round(started - loaded, 2),
                "curve": curve,
            },
            indent=1,
        )
    )


if __name__ == "__main__":
    main()
