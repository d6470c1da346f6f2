"""Training a probability field by sparse products; `--json FILE` keeps the times.

The scene is that of `bench_kernels.py`, seen by four cameras; the masks are what a tenth of the ball covers. `rays` = 1
takes every pixel, as renders and their gradients would; `rays` = 4 is the default of `segment`, one of 4 x 4 px.
"""

from __future__ import annotations

import argparse
import json
import time
from itertools import islice
from pathlib import Path

import numpy as np
from bench_kernels import ball

from cotton3dg.core.scene import Camera
from cotton3dg.lifting.probability import sample_view, train_probabilities
from cotton3dg.splat.rasterizer import render_values


def around(width: int, height: int, count: int) -> list[Camera]:
    views = []
    for angle in 2 * np.pi * np.arange(count) / count:
        c, s = np.cos(angle), np.sin(angle)
        pose = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 2.6]])
        views.append(Camera("around", width, height, 1.1 * width, 1.1 * width, width / 2, height / 2, pose))
    return views


def measure(count: int, width: int, height: int, steps: int) -> dict[str, object]:
    gaussians, cameras = ball(count), around(width, height, 4)
    lint = (np.linalg.norm(gaussians.means - [0.3, 0.2, 0], axis=1) < 0.45).astype(np.float32)[:, None]
    masks = [render_values(gaussians, camera, lint).image[..., 0] > 0.5 for camera in cameras]
    pairs = list(zip(cameras, masks, strict=True))
    result: dict[str, object] = {"gaussians": count, "width": width, "height": height, "steps": steps}
    for name, prepare in (
        ("rays_1", lambda: [sample_view(gaussians, *pair, 1, 0) for pair in pairs]),
        ("rays_4", lambda: [sample_view(gaussians, *pair, 4, 0) for pair in pairs]),
    ):
        begin, begin_cpu = time.perf_counter(), time.process_time()
        views = prepare()
        prepared, prepared_cpu = time.perf_counter(), time.process_time()
        training = train_probabilities(views, np.full(count, 0.5, np.float32), steps)
        next(islice(training, steps - 1, None))
        result[name] = {
            "ms_per_view_once": 1e3 * (prepared - begin) / len(views),
            "cpu_ms_per_view_once": 1e3 * (prepared_cpu - begin_cpu) / len(views),
            "ms_per_step": 1e3 * (time.perf_counter() - prepared) / steps,
            "cpu_ms_per_step": 1e3 * (time.process_time() - prepared_cpu) / steps,
        }
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gaussians", type=int, default=200_000)
    parser.add_argument("--width", type=int, default=960)
    parser.add_argument("--height", type=int, default=540)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    result = measure(arguments.gaussians, arguments.width, arguments.height, arguments.steps)
    text = json.dumps(result, indent=1)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")


if __name__ == "__main__":
    main()
