# SPDX-License-Identifier: Apache-2.0
"""How good OpenSplat's CPU path and ours become in how much time, from the points of structure from motion on.

    python tests/benchmarks/bench_opensplat_quality.py PLANT_DIR OPENSPLAT [--max-side 960] [--minutes 15] [--every 100]
        [-n 30000 ...]

OPENSPLAT is as in `bench_opensplat.py`; what else is given are options of its own. Both are judged on the first image
that ours holds out, which OpenSplat withholds, too, each by what it renders itself: OpenSplat's CPU path also draws
what lies behind the camera and learns with that, so that any other program shows its models wrong. Prints a JSON object
for each model; clock and processor time (of all threads) have loading in them, OpenSplat's also a render every ten
steps.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from bench_opensplat import lay_out
from numpy.typing import NDArray

from cotton3dg.core.scene import Gaussians
from cotton3dg.gaussians.metrics import psnr_db, to_uint8
from cotton3dg.gaussians.rasterizer import render
from cotton3dg.gaussians.views import View
from cotton3dg.io.colmap import read_points
from cotton3dg.io.images import read_image
from cotton3dg.options import resolve
from cotton3dg.study.plant_region import PlantRegions
from cotton3dg.train.initialise import start_gaussians
from cotton3dg.train.stage import load_capture, load_windows
from cotton3dg.train.trainer import fit
from cotton3dg.workspace import Workspace

RENDERED_EVERY = 10
"""Steps between two images that OpenSplat renders."""


class Judge(NamedTuple):
    """What is said of the renders of one image."""

    view: View
    region: NDArray[np.bool_]
    """(H, W) the plant."""

    def say(self, trainer: str, step: int, seconds: float, cpu_seconds: float, image: NDArray[np.uint8]) -> None:
        qualities = {
            "psnr_db": round(psnr_db(image, self.view.image), 2),
            "plant_psnr_db": round(psnr_db(image, self.view.image, self.region), 2),
        }
        times = {"seconds": round(seconds, 1), "cpu_seconds": round(cpu_seconds, 1)}
        print(json.dumps({"trainer": trainer, "step": step, **times, **qualities}), flush=True)


def processor_seconds(process: int) -> float:
    """Of a process that was not waited for yet, all its threads."""
    after_name = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(after_name[11]) + int(after_name[12])) / os.sysconf("SC_CLK_TCK")


def watch_opensplat(running: subprocess.Popen, renders: Path, every: int) -> Iterator[tuple[int, float, float, Path]]:
    """Step, clock and processor time and the image of each render that is whole, as it comes."""
    began, step = time.perf_counter(), every
    while True:
        seconds, cpu_seconds = time.perf_counter() - began, processor_seconds(running.pid)
        ended = running.poll() is not None
        # The one after it has begun, so this one was written.
        if ended or (renders / f"{step + RENDERED_EVERY}.png").exists():
            if not (renders / f"{step}.png").exists():
                return
            yield step, seconds, cpu_seconds, renders / f"{step}.png"
            step += every
        elif not ended:
            time.sleep(0.2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plant", type=Path)
    parser.add_argument("opensplat", type=Path)
    parser.add_argument("--max-side", type=int, default=resolve("train", {}).max_side, help="of the images, px")
    parser.add_argument("--minutes", type=float, default=15.0, help="that OpenSplat has")
    parser.add_argument("--every", type=int, default=100, help="steps between two that are judged, a multiple of 10")
    arguments, theirs = parser.parse_known_args()
    plant, options = Workspace(arguments.plant), resolve("train", {"max_side": str(arguments.max_side)})
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # or OpenSplat would go on alone

    began, cpu_began = time.perf_counter(), time.process_time()
    capture = load_capture(plant, options)
    points, colours, _, _ = read_points(plant.undistorted / "sparse")
    judge = Judge(capture.held_out[0], PlantRegions().of_held_out(capture.views, options.holdout, points)[0])
    judging = cpu_judging = 0.0

    def watch(step: int, gaussians: Gaussians) -> None:
        if step % arguments.every == 0 and step != options.steps:
            judge_ours(step, gaussians)

    def judge_ours(step: int, gaussians: Gaussians) -> None:
        nonlocal judging, cpu_judging
        now, cpu_now = time.perf_counter(), time.process_time()
        image = to_uint8(render(gaussians, judge.view.camera).image)
        judge.say("ours", step, now - began - judging, cpu_now - cpu_began - cpu_judging, image)
        judging, cpu_judging = judging + time.perf_counter() - now, cpu_judging + time.process_time() - cpu_now

    start = start_gaussians(points, colours, capture.training, options)
    windows = load_windows(plant, options, capture.training)
    judge_ours(options.steps, fit(start, capture.training, options, watch=watch, windows=windows).gaussians)

    with tempfile.TemporaryDirectory() as folder:
        project, factor = lay_out(plant, Path(folder), arguments.max_side)
        renders = Path(folder) / "renders"
        command = [arguments.opensplat, project, "--keep-crs", "--cpu", "-d", str(factor), *theirs]
        command += ["--val", "--val-image", judge.view.camera.name, "--val-render", renders]
        running = subprocess.Popen([*command, "-o", Path(folder) / "out.ply"], stdout=subprocess.DEVNULL)
        try:
            for step, seconds, cpu_seconds, path in watch_opensplat(running, renders, arguments.every):
                judge.say("OpenSplat", step, seconds, cpu_seconds, read_image(path))
                if seconds > 60 * arguments.minutes:
                    break
        finally:
            running.kill()
            running.wait()


if __name__ == "__main__":
    main()
