"""How good OpenSplat's CPU path becomes in how much time, from the points of structure from motion on.

    python tests/benchmarks/bench_opensplat_quality.py PLANT_DIR OPENSPLAT FOLDER [--max-side 960] [--minutes 15]
        [--every 100] [-n 30000 ...]

OPENSPLAT is as in `bench_opensplat.py`; what else is given are options of its own. Our trainer's curve is
`bench_train.py PLANT_DIR --every 100` (`--set max_side=480` for a smaller size). Both are judged on the images that
ours holds out, at its size; OpenSplat trains on these, too. It is stopped while a model is judged, and the clock with
it. Prints a JSON object a model that it saved; `cpu_seconds` counts all threads. FOLDER keeps these and the last model:
the same command goes on from there.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from bench_opensplat import lay_out

from cotton3dg.core.scene import Gaussians
from cotton3dg.files.colmap import read_points
from cotton3dg.files.ply import read_gaussians
from cotton3dg.options import resolve
from cotton3dg.splat.metrics import psnr_db, to_uint8
from cotton3dg.splat.rasterizer import render
from cotton3dg.stages.train import load_capture
from cotton3dg.study.plant_region import PlantRegions
from cotton3dg.workspace import Workspace

BACKGROUND = (0.6130, 0.0101, 0.3984)
"""Colour behind everything that OpenSplat trains with; rendered before black, what it left thin has a cast."""


def processor_seconds(process: int) -> float:
    """Of a running process, all its threads."""
    after_name = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(after_name[11]) + int(after_name[12])) / os.sysconf("SC_CLK_TCK")


def read_finite(model: Path) -> Gaussians:
    """A model of columns of single precision without the Gaussians that are not finite: OpenSplat keeps some."""
    head, body = model.read_bytes().split(b"end_header\n", 1)
    table = np.frombuffer(body, "<f4").reshape(-1, head.count(b"property float"))
    finite = table[np.isfinite(table).all(axis=1)]
    counted = head.replace(f"element vertex {len(table)}".encode(), f"element vertex {len(finite)}".encode())
    with tempfile.NamedTemporaryFile(suffix=".ply") as file:
        file.write(counted + b"end_header\n" + finite.tobytes())
        file.flush()
        return read_gaussians(Path(file.name))


def is_whole(path: Path, pause_s: float = 1.0) -> bool:
    """Whether a file is there that did not grow in a while."""
    size = path.stat().st_size if path.exists() else 0
    time.sleep(pause_s)
    return size > 0 and path.stat().st_size == size


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plant", type=Path)
    parser.add_argument("opensplat", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--max-side", type=int, default=resolve("train", {}).max_side, help="of the images, px")
    parser.add_argument("--minutes", type=float, default=15.0)
    parser.add_argument("--every", type=int, default=100, help="steps between two models that are judged")
    arguments, theirs = parser.parse_known_args()
    plant, options = Workspace(arguments.plant), resolve("train", {"max_side": str(arguments.max_side)})
    capture = load_capture(plant, options)
    points = read_points(plant.undistorted / "sparse")[0]
    regions = PlantRegions().of_held_out(capture.views, options.holdout, points)

    def judge(model: Path) -> dict[str, float]:
        gaussians = read_finite(model)
        renders = [to_uint8(render(gaussians, view.camera, background=BACKGROUND).image) for view in capture.held_out]
        pairs = [(ours, view.image) for ours, view in zip(renders, capture.held_out, strict=True)]
        of_plant = [psnr_db(*pair, region) for pair, region in zip(pairs, regions, strict=True)]
        return {
            "n_gaussians": len(gaussians),
            "psnr_db": round(float(np.mean([psnr_db(*pair) for pair in pairs])), 2),
            "plant_psnr_db": round(float(np.nanmean(of_plant)), 2),
        }

    folder, rows = arguments.folder, arguments.folder / "curve.jsonl"
    before = [json.loads(line) for line in rows.read_text().splitlines()] if rows.exists() else []
    last = before[-1] if before else {"step": 0, "seconds": 0.0, "cpu_seconds": 0.0}
    folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(folder / "project", ignore_errors=True)
    for model in set(folder.glob("out_*.ply")) - {folder / f"out_{last['step']}.ply"}:
        model.unlink()
    project, factor = lay_out(plant, folder, arguments.max_side)
    command = [arguments.opensplat, project, "--keep-crs", "--cpu", "-d", str(factor)]
    command += ["-s", str(arguments.every), "-o", folder / "out.ply", *theirs]
    if before:
        command += ["--resume", folder / f"out_{last['step']}.ply"]
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # or it would go on alone
    began, judging, step = time.perf_counter(), 0.0, last["step"] + arguments.every
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        while running.poll() is None and time.perf_counter() - began - judging < 60 * arguments.minutes:
            following = folder / f"out_{step}.ply"
            if not is_whole(following):
                continue
            now = time.perf_counter()
            running.send_signal(signal.SIGSTOP)
            seconds = round(last["seconds"] + now - began - judging, 1)
            cpu_seconds = round(last["cpu_seconds"] + processor_seconds(running.pid), 1)
            row = {"step": step, "seconds": seconds, "cpu_seconds": cpu_seconds, **judge(following)}
            print(json.dumps(row), flush=True)
            with rows.open("a") as curve:
                curve.write(json.dumps(row) + "\n")
            (folder / f"out_{step - arguments.every}.ply").unlink(missing_ok=True)
            running.send_signal(signal.SIGCONT)
            judging += time.perf_counter() - now
            step += arguments.every
    finally:
        running.kill()
        running.wait()


if __name__ == "__main__":
    main()
