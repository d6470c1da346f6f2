# SPDX-License-Identifier: Apache-2.0
"""Times of the native core; `bench_kernels.py --json FILE` keeps them.

`parts`: one training step by part, with the nanoseconds that the forward and the backward kernel take for a pair of a
pixel and a Gaussian, for every instruction set and number of threads, on a made ball and on the scenes given.
`steps`: whole training steps over the numbers of Gaussians, pixels and threads. `calls`: what else the core computes.

At 200,000 Gaussians and 960 x 540 px the ball is as dense as the one that the project's speed targets are stated for.
Times are medians in ms; cpu_ms is the processor time of all threads, which a busy machine disturbs less.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import native_parts
import numpy as np

from cotton3dg import _native
from cotton3dg.core.scene import SH_CONSTANT, Camera, Gaussians
from cotton3dg.gaussians import rasterizer
from cotton3dg.io.ply import read_gaussians
from cotton3dg.train.stage import load_views
from cotton3dg.workspace import Workspace

STILL = rasterizer.LearningRates(0, 0, 0, 0, 0, 0)  # the same work every time
SIZES = ((480, 270), (960, 540))
COUNTS = (10_000, 50_000, 100_000, 200_000)
Scene = tuple[Gaussians, Camera, np.ndarray]


def ball(count: int, seed: int = 0) -> Gaussians:
    """Gaussians evenly in the unit ball; their size shrinks with their number, so that the blending stays as deep."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    size = 0.0068 * np.sqrt(200_000 / count)
    return Gaussians(
        (directions * rng.uniform(0, 1, (count, 1)) ** (1 / 3)).astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        np.log(rng.uniform(0.3, 1.5, (count, 3)) * size).astype(np.float32),
        rng.normal(-2, 1, count).astype(np.float32),
        rng.normal(0, 0.2, (count, 16, 3)).astype(np.float32),
    )


def ball_scene(count: int, width: int, height: int) -> Scene:
    pose = np.eye(3, 4)
    pose[2, 3] = 2.6
    camera = Camera("front", width, height, 1.1 * width, 1.1 * width, width / 2, height / 2, pose)
    return ball(count), camera, np.random.default_rng(1).integers(0, 256, (height, width, 3)).astype(np.uint8)


def plant_scene(plant: Path, max_side: int = 960) -> Scene:
    """A trained plant in its first photo."""
    workspace = Workspace(plant)
    view = load_views(workspace, max_side)[0]
    return read_gaussians(workspace.gaussians_ply), view.camera, view.image


def points_scene(path: Path) -> Scene:
    """The points of gsplat's garden test file as round Gaussians, as wide as the distance of their neighbours."""
    from scipy.spatial import cKDTree

    points = np.load(path, allow_pickle=False)
    means = points["means3d"].astype(np.float32)
    spacing = cKDTree(means).query(means, 4, workers=2)[0][:, 1:].mean(1).clip(1e-6)
    sh = np.zeros((len(means), 16, 3), np.float32)
    sh[:, 0] = (points["colors"] / 255 - 0.5) / SH_CONSTANT
    gaussians = Gaussians(
        means,
        np.tile(np.float32([1, 0, 0, 0]), (len(means), 1)),
        np.log(spacing)[:, None].repeat(3, 1).astype(np.float32),
        np.zeros(len(means), np.float32),
        sh,
    )
    width, height, lens = int(points["width"]), int(points["height"]), points["Ks"][0]
    pose = points["viewmats"][0][:3].astype(np.float64)
    camera = Camera("first", width, height, lens[0, 0], lens[1, 1], lens[0, 2], lens[1, 2], pose)
    return gaussians, camera, np.full((height, width, 3), 128, np.uint8)


def timed(compute: Callable[[], object], repeats: int) -> dict[str, float]:
    compute()
    wall, cpu = [], []
    for _ in range(repeats):
        begin, begin_cpu = time.perf_counter(), time.process_time()
        compute()
        wall.append(time.perf_counter() - begin)
        cpu.append(time.process_time() - begin_cpu)
    return {"ms": 1e3 * float(np.median(wall)), "cpu_ms": 1e3 * float(np.median(cpu))}


def parts(scenes: dict[str, Scene], threads: list[int], repeats: int) -> Iterator[dict[str, object]]:
    program = native_parts.build()
    with tempfile.TemporaryDirectory() as folder:
        for name, scene in scenes.items():
            path = Path(folder) / "scene.bin"
            native_parts.write_scene(path, *scene)
            about = {"scene": name, "gaussians": len(scene[0]), "size": [scene[1].width, scene[1].height]}
            for instruction_set in _native.instruction_sets():
                for n in threads:
                    result = native_parts.measure(program, path, instruction_set, n, repeats)
                    yield about | {"instruction_set": instruction_set, "threads": n} | result


def steps(threads: list[int], repeats: int) -> Iterator[dict[str, object]]:
    for width, height in SIZES:
        for count in COUNTS:
            gaussians, camera, target = ball_scene(count, width, height)
            adam, statistics = rasterizer.AdamState.zeros(gaussians), rasterizer.DensityStatistics.zeros(count)
            step = partial(rasterizer.train_step, gaussians, adam, statistics, camera, target)
            for n in threads:
                times = timed(partial(step, sh_degree=3, learning_rates=STILL, threads=n), repeats)
                yield {"gaussians": count, "size": [width, height], "threads": n} | times


def calls(threads: int, repeats: int) -> dict[str, dict[str, float]]:
    gaussians, camera, target = ball_scene(200_000, 960, 540)
    rng = np.random.default_rng(1)
    ids = rng.integers(0, 40, (68, 120)).repeat(8, 0).repeat(8, 1)[:540].astype(np.uint16)
    image = rng.uniform(0, 1, (540, 960, 3)).astype(np.float32)
    values = rng.normal(size=(len(gaussians), 16)).astype(np.float32)
    computations = {
        "render": lambda: rasterizer.render(gaussians, camera, threads=threads),
        "image_loss": lambda: _native.for_tests.image_loss(image, target, 0.2, threads),
        "render_values_16": lambda: rasterizer.render_values(gaussians, camera, values, threads=threads),
        "accumulate_weights": lambda: rasterizer.accumulate_weights(gaussians, camera, ids, threads=threads),
    }
    return {name: timed(compute, repeats) for name, compute in computations.items()}


def processor() -> str:
    """The name that the operating system gives to the processor."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text().splitlines() if information.exists() else []
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write the results here")
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--plants", type=Path, nargs="*", default=[], help="folders of plants that have been trained")
    parser.add_argument("--garden", type=Path, help="test_garden.npz of gsplat")
    options = parser.parse_args()
    cores = os.cpu_count() or 1
    threads = sorted({1, cores})
    scenes = {"ball": ball_scene(200_000, 960, 540)}
    scenes |= {plant.resolve().name: plant_scene(plant) for plant in options.plants}
    if options.garden:
        scenes["garden"] = points_scene(options.garden)
    results = {
        "processor": processor(),
        "cores": cores,
        "instruction_set": _native.instruction_set(),
        "parts": list(parts(scenes, threads, options.repeats)),
        "steps": list(steps(threads, options.repeats)),
        "calls": calls(cores, options.repeats),
    }
    text = json.dumps(results, indent=1)
    print(text)
    if options.json:
        options.json.write_text(text + "\n")


if __name__ == "__main__":
    main()
