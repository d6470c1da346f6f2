# SPDX-License-Identifier: Apache-2.0
"""What each guard against bad numbers costs: training steps of builds with and without it, taken in turns.

    python tests/benchmarks/bench_guards.py [--rounds 40] [--json FILE]

Single-threaded, in processor time, the two builds step by step after each other on the same scene; the figure is the
median of the paired ratios. Guards that only exist between steps (checkpoints) are timed by themselves.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(TESTS), str(TESTS / "native")]

import numpy as np  # noqa: E402
from scratch_build import build  # noqa: E402
from source_changes import ROOT, Change  # noqa: E402

N_GAUSSIANS, WIDTH, HEIGHT = 40_000, 640, 360
STEPS = 4
"""Steps in each turn."""
GUARDS: dict[str, tuple[Change, ...]] = {
    "parameters that are not finite are culled": (Change(
        "project.h", "project", "!(@flags[@lane] == 0) ? kNonFinite", "false ? kNonFinite"
    ),),
    "projections and colours that are not finite are culled": (
        Change("project.h", "project", "for (double @number : @numbers) @all &= finite(@number);", "(void)@numbers;"),
        Change(
            "project.h", "write_values",
            "@usable &= scene.sh ? @to[@c] <= Real(kMaxColour) && @to[@c] >= Real(-kMaxColour) "
            ": @to[@c] - @to[@c] == 0;",
            "",
        ),
    ),
    "quaternions without direction are culled": (Change(
        "geometry.h", "footprint", "@f.degenerate = ~(@largest > 1e-30);", "@f.degenerate = PackMask{};"
    ),),
    "log scales are clamped": (
        Change("geometry.h", "footprint", "(@log > -kMaxLogScale) & (@log < kMaxLogScale)", "~PackMask{}"),
        Change(
            "geometry.h", "footprint",
            "minimum(maximum(@log_scale, Pack{} - kMaxLogScale), Pack{} + kMaxLogScale)",
            "@log_scale",
        ),
    ),
    "determinant from minors": (Change(
        "geometry.h", "footprint",
        "@f.det = @a * @a + @b * @b + @c * @c + kDilation * (@xx + @yy) + kDilation * kDilation;",
        "(void)@a, (void)@b, (void)@c; @f.det = @f.xx * @f.yy - @f.xy * @f.xy;",
    ),),
    "a saturated alpha has no gradient": (Change(
        "rasterize.h", "backward",
        "@blend.alpha[@j] < Real(kAlphaCap) ? fnma(@odds, @rest, @here) : V{}",
        "fnma(@odds, @rest, @here)",
    ),),
    "gradients are checked before the step": (Change(
        "project_backward.h", "project_backward",
        "for (int @k = 0; @k < row_gradient::unit; @k += kLanes<Real>) @sum += load(@row + @k) * Real(0);",
        "",
    ),),
    "Adam's gradients are clamped": (Change(
        "adam.h", "update",
        "minimum(maximum(@gradient, V{} - kLargestGradient), V{} + kLargestGradient)",
        "@gradient",
    ),),
    "SSIM is at most 1": (
        Change(
            "ssim.h", "loss_forward",
            "maximum(@blurred[2] - @m11 - @m22, V{}) + Real(kC2)", "@blurred[2] - @m11 - @m22 + Real(kC2)",
        ),
        Change(
            "ssim.h", "loss_forward",
            "minimum(2 * (@blurred[3] - @m12) + Real(kC2), @b2)", "2 * (@blurred[3] - @m12) + Real(kC2)",
        ),
    ),
}  # fmt: skip


def work() -> None:
    """The other process: takes STEPS steps for each line on stdin and tells their processor time."""
    importlib.import_module("conftest")  # puts the build under test in place
    from scenes.splat_scenes import RATES, camera_at, scene, target_of

    from cotton3dg.gaussians import rasterizer

    gaussians, camera = scene(N_GAUSSIANS, seed=0, coefficients=4), camera_at(WIDTH, HEIGHT)
    gaussians.log_scales[:] -= 1.5
    adam, statistics, target = (
        rasterizer.AdamState.zeros(gaussians),
        rasterizer.DensityStatistics.zeros(N_GAUSSIANS),
        target_of(camera),
    )
    for _ in sys.stdin:
        began = time.process_time()
        for _ in range(STEPS):
            rasterizer.train_step(
                gaussians, adam, statistics, camera, target,
                sh_degree=1, learning_rates=RATES, near_su=0.05, threads=1,
            )  # fmt: skip
        print(time.process_time() - began, flush=True)


class Worker:
    """A process with one build of the core."""

    def __init__(self, module: Path) -> None:
        environment = os.environ | {"COTTON3DG_REPLACED": f"cotton3dg._native={module}"}
        self.process = subprocess.Popen(
            [sys.executable, __file__, "--worker"],
            env=environment,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self.seconds()

    def seconds(self) -> float:
        to, back = self.process.stdin, self.process.stdout
        assert to
        assert back
        to.write("\n")
        to.flush()
        return float(back.readline())

    def end(self) -> None:
        assert self.process.stdin
        self.process.stdin.close()
        self.process.wait()


def cost_pct(guarded: Path, bare: Path, rounds: int) -> tuple[float, float]:
    """Median of what the guards add to a step, %, and the standard error of it."""
    workers = [Worker(guarded), Worker(bare)]
    ratios = []
    for number in range(rounds):
        pair = workers if number % 2 else workers[::-1]
        seconds = [worker.seconds() for worker in pair]
        ratios.append(seconds[0] / seconds[1] if number % 2 else seconds[1] / seconds[0])
    for worker in workers:
        worker.end()
    spread = 1.4826 * np.median(np.abs(ratios - np.median(ratios)))
    return 100 * (float(np.median(ratios)) - 1), 100 * 1.2533 * float(spread) / np.sqrt(rounds)


def checkpoint_pct() -> float:
    """What saving a training of 150,000 Gaussians once in SAVED_EVERY_S costs, %."""
    from scenes.splat_scenes import scene

    from cotton3dg.io.saving import replacing
    from cotton3dg.train.checkpoint import write_training
    from cotton3dg.train.trainer import SAVED_EVERY_S, Training

    training = Training.of(scene(150_000, seed=0, coefficients=4))
    with tempfile.TemporaryDirectory(dir=ROOT) as folder:
        began = time.perf_counter()
        with replacing(Path(folder) / "checkpoint.npz") as path:
            write_training(path, training, "key")
        return 100 * (time.perf_counter() - began) / SAVED_EVERY_S


def main(rounds: int, target: Path | None) -> None:
    # Aligned, because where the code of a loop happens to lie moves a step by more than all guards do.
    flags = "-O2 -falign-functions=64 -falign-loops=32 -falign-jumps=16"
    options = {"flags": flags, "isas": "baseline;avx2", "optimisation": "-O3"}
    guarded = build(ROOT / "build" / "guards" / "all", **options)  # type: ignore[arg-type]
    every = tuple(change for changes in GUARDS.values() for change in changes)
    results = {}
    for name, changes in {"all of these": every, **GUARDS}.items():
        folder = ROOT / "build" / "guards" / "without"
        bare = build(folder, changes=changes, **options)  # type: ignore[arg-type]
        cost, error = cost_pct(guarded, bare, rounds)
        results[name] = {"cost_pct": round(cost, 2), "standard_error_pct": round(error, 2)}
        print(f"{cost:6.2f} % ± {error:.2f}  {name}", flush=True)
    results["checkpoints"] = {"cost_pct": round(checkpoint_pct(), 2)}
    print(f"{results['checkpoints']['cost_pct']:6.2f} %         checkpoints")
    if target:
        target.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--worker", action="store_true")
    wanted = parser.parse_args()
    if wanted.worker:
        work()
    else:
        main(wanted.rounds, wanted.json)
