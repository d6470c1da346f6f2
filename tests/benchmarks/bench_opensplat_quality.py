"""How good OpenSplat's CPU path becomes in how much time, from the points of structure from motion on.

    python tests/benchmarks/bench_opensplat_quality.py PLANT_DIR OPENSPLAT [--minutes 15] [--every 100] [-n 30000 ...]

OPENSPLAT is as in `bench_opensplat.py`; what else is given are options of its own. Our trainer's curve is
`bench_train.py PLANT_DIR --every 100`. Both are judged on the images that ours holds out, at its size; OpenSplat trains
on these, too. It is stopped while a model is judged, and the clock with it. Prints a JSON object a model that it saved.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from bench_opensplat import lay_out

from cotton3dg.files.colmap import read_points
from cotton3dg.files.ply import read_gaussians
from cotton3dg.options import resolve
from cotton3dg.splat.metrics import view_quality
from cotton3dg.stages.train import load_capture
from cotton3dg.study.plant_region import PlantRegions
from cotton3dg.workspace import Workspace


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plant", type=Path)
    parser.add_argument("opensplat", type=Path)
    parser.add_argument("--minutes", type=float, default=15.0)
    parser.add_argument("--every", type=int, default=100, help="steps between two models that are judged")
    arguments, theirs = parser.parse_known_args()
    plant, options = Workspace(arguments.plant), resolve("train", {})
    capture = load_capture(plant, options)
    points = read_points(plant.undistorted / "sparse")[0]
    regions = PlantRegions().of_held_out(capture.views, options.holdout, points)

    def judge(model: Path) -> dict[str, float]:
        gaussians = read_gaussians(model)
        qualities = [
            view_quality(gaussians, view, region) for view, region in zip(capture.held_out, regions, strict=True)
        ]
        return {
            "n_gaussians": len(gaussians),
            "psnr_db": round(float(np.mean([quality.psnr_db for quality in qualities])), 2),
            "plant_psnr_db": round(float(np.nanmean([quality.plant_psnr_db for quality in qualities])), 2),
        }

    with tempfile.TemporaryDirectory() as folder:
        project, factor = lay_out(plant, Path(folder))
        command = [arguments.opensplat, project, "--keep-crs", "--cpu", "-d", str(factor)]
        command += ["-s", str(arguments.every), "-o", Path(folder) / "out.ply", *theirs]
        began, judging, step = time.perf_counter(), 0.0, arguments.every
        running = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        try:
            while running.poll() is None and time.perf_counter() - began - judging < 60 * arguments.minutes:
                following = Path(folder) / f"out_{step}.ply"
                if not following.exists():
                    time.sleep(0.1)
                    continue
                time.sleep(0.5)  # until it is written
                now = time.perf_counter()
                running.send_signal(signal.SIGSTOP)
                seconds = round(now - began - judging, 1)
                print(json.dumps({"step": step, "seconds": seconds, **judge(following)}), flush=True)
                running.send_signal(signal.SIGCONT)
                judging += time.perf_counter() - now
                step += arguments.every
        finally:
            running.kill()
            running.wait()


if __name__ == "__main__":
    main()
