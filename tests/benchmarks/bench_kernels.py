"""Times of the native core on a made ball of Gaussians; `bench_kernels.py --json FILE` keeps them.

At 200,000 Gaussians and 960 x 540 px the ball is as dense as the one that the project's speed targets are stated for.
Times are medians in ms; cpu_ms is the processor time of all threads, which a busy machine disturbs less.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from cotton3dg import _native
from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.splat import ops


def ball(count: int, seed: int = 0) -> Gaussians:
    """Gaussians evenly in the unit ball; their size shrinks with their number, so that the blending stays as deep."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    size = 0.0075 * np.sqrt(200_000 / count)
    return Gaussians(
        (directions * rng.uniform(0, 1, (count, 1)) ** (1 / 3)).astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        np.log(rng.uniform(0.3, 1.5, (count, 3)) * size).astype(np.float32),
        rng.normal(-2, 1, count).astype(np.float32),
        rng.normal(0, 0.2, (count, 16, 3)).astype(np.float32),
    )


def front_camera(width: int, height: int) -> Camera:
    pose = np.eye(3, 4)
    pose[2, 3] = 2.6
    return Camera("front", width, height, 1.1 * width, 1.1 * width, width / 2, height / 2, pose)


def timed(compute: Callable[[], object], repeats: int) -> dict[str, float]:
    compute()
    wall, cpu = [], []
    for _ in range(repeats):
        begin, begin_cpu = time.perf_counter(), time.process_time()
        compute()
        wall.append(time.perf_counter() - begin)
        cpu.append(time.process_time() - begin_cpu)
    return {"ms": 1e3 * float(np.median(wall)), "cpu_ms": 1e3 * float(np.median(cpu))}


def measure(count: int, width: int, height: int, threads: int, repeats: int) -> dict[str, object]:
    gaussians, camera = ball(count), front_camera(width, height)
    rng = np.random.default_rng(1)
    target = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    ids = (rng.integers(0, 40, (height // 8 + 1, width // 8 + 1)).repeat(8, 0).repeat(8, 1))[:height, :width]
    image = rng.uniform(0, 1, (height, width, 3)).astype(np.float32)
    v_image = rng.normal(size=(height, width, 16)).astype(np.float32)
    values = rng.normal(size=(count, 16)).astype(np.float32)
    adam, statistics = ops.AdamState.zeros(gaussians), ops.DensityStatistics.zeros(count)
    still = ops.LearningRates(0, 0, 0, 0, 0, 0)  # the same work every time

    def step() -> object:
        return ops.train_step(
            gaussians, adam, statistics, camera, target, sh_degree=3, learning_rates=still, threads=threads
        )

    rendered = ops.render(gaussians, camera, threads=threads)
    return {
        "gaussians": count,
        "size": [width, height],
        "threads": threads,
        "pairs": rendered.n_pairs,
        "visible": rendered.n_visible,
        "train_step": timed(step, repeats),
        "render": timed(lambda: ops.render(gaussians, camera, threads=threads), repeats),
        "image_loss": timed(lambda: ops.image_loss(image, target, threads=threads), repeats),
        "render_values_16": timed(lambda: ops.render_values(gaussians, camera, values, threads=threads), repeats),
        "values_gradient_16": timed(lambda: ops.values_gradient(gaussians, camera, v_image, threads=threads), repeats),
        "accumulate_weights": timed(
            lambda: ops.accumulate_weights(gaussians, camera, ids.astype(np.uint16), threads=threads), repeats
        ),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the results here")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--counts", type=int, nargs="+", default=[20_000, 200_000])
    options = parser.parse_args()
    cores = os.cpu_count() or 1
    results = {
        "instruction_set": _native.instruction_set(),
        "cores": cores,
        "runs": [
            measure(count, 960, 540, threads, options.repeats)
            for count in options.counts
            for threads in sorted({1, cores})
        ],
    }
    text = json.dumps(results, indent=1)
    print(text)
    if options.json:
        options.json.write_text(text + "\n")


if __name__ == "__main__":
    main()
