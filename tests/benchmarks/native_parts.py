# SPDX-License-Identifier: Apache-2.0
"""Builds bench_parts, the native half of the benchmarks, and runs it on a scene."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians import rasterizer

ROOT = Path(__file__).parents[2]


def build(root: Path = ROOT) -> Path:
    """bench_parts of the sources in `root`; cmake and ninja are those of this Python's environment."""
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    folder = root / "build" / "bench"
    configure = ["cmake", "-G", "Ninja", "-S", root / "native", "-B", folder, f"-DPython_EXECUTABLE={sys.executable}"]
    configure.append(f"-Dpybind11_DIR={_pybind11_cmake_dir()}")
    for command in (configure, ["cmake", "--build", folder, "--target", "bench_parts"]):
        subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
    return folder / "bench_parts"


def write_scene(path: Path, gaussians: Gaussians, camera: Camera, target: np.ndarray) -> None:
    """The layout is described in bench_parts.cpp."""
    pose = camera.cam_from_scene
    lens = [camera.fx, camera.fy, camera.cx, camera.cy]
    numbers = [*lens, *pose[:, :3].ravel(), *pose[:, 3], rasterizer.near_plane(gaussians, camera)]
    g = gaussians
    with path.open("wb") as file:
        np.array([len(g), g.sh.shape[1], camera.width, camera.height], np.int32).tofile(file)
        np.array(numbers, np.float64).tofile(file)
        for array in (g.means, g.quats, g.log_scales, g.opacity_logits, g.sh):
            array.astype(np.float32).tofile(file)
        target.astype(np.uint8).tofile(file)


def measure(program: Path, scene: Path, instruction_set: str, threads: int, repeats: int) -> dict[str, object]:
    """What bench_parts prints."""
    command = [program, scene, instruction_set, str(threads), str(repeats)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def _pybind11_cmake_dir() -> str:
    import pybind11

    return pybind11.get_cmake_dir()
