# SPDX-License-Identifier: Apache-2.0
"""The speed of this machine: a few seconds of the splatting core and of image features, on synthetic data.

The result is kept in the user's cache folder, for all plants.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from .. import _native
from ..core.machine import usable_cores
from ..core.scene import Camera, Gaussians
from ..errors import BadInput
from ..gaussians.rasterizer import train_step
from ..gaussians.state import AdamState, DensityStatistics, LearningRates
from ..schemas.document import Document
from .cost import Machine

VERSION: Final = 2
"""Raised when the measurement, or its reference, changes."""

SPLATTING_S: Final = 0.040
IMAGING_S: Final = 0.36
"""CPU-seconds of one step and of one image on the machines on which the constants of `cost` were measured."""
SPLATTING_TIMES: Final = 20
IMAGING_TIMES: Final = 6
BUSY: Final = 0.5
"""Load per core from which on other programs keep this one from using all cores."""

N_GAUSSIANS: Final = 60_000
SPLATTED_PX: Final = (480, 270)
FEATURES_PX: Final = (1280, 720)


@dataclass(frozen=True)
class Calibration(Document):
    """The measurement and its machine."""

    REMEDY = "run `cotton3dg doctor --calibrate`"

    of: dict[str, Any]
    """The machine for which it holds, from `_identity`."""
    machine: Machine


def read_or_calibrate(tell: Callable[[str], None] = print) -> Machine:
    """The measurement of this machine; measures now if none exists for this version, processor and number of cores."""
    saved = read_calibration()
    if saved is None:
        tell("measuring this machine once, some 10 s; `cotton3dg doctor --calibrate` does it again")
        return calibrate()
    return saved


def read_calibration() -> Machine | None:
    """The measurement of this machine, if it still holds."""
    try:
        saved = Calibration.load(_saved_json())
    except (BadInput, RuntimeError):
        return None
    return saved.machine if saved.of == _identity() else None


def calibrate() -> Machine:
    """Measure, and keep the measurement.

    It uses the processor's time rather than the clock's, because other programs hardly change it. The number of cores
    that really work at once is the largest one seen or, if other programs compute meanwhile, all of them.
    """
    usable = len(usable_cores())
    busy = hasattr(os, "getloadavg") and os.getloadavg()[0] > BUSY * usable
    splatting_s, seen = _measure_least(_prepare_splatting(), SPLATTING_TIMES)
    imaging_s, _ = _measure_least(_prepare_features(), IMAGING_TIMES)
    machine = Machine(
        cores=float(usable) if busy else round(min(max(seen, 1.0), usable), 2),
        splatting=round(splatting_s / SPLATTING_S, 3),
        imaging=round(imaging_s / IMAGING_S, 3),
    )
    with suppress(OSError, RuntimeError):  # nowhere to keep it: the next run measures again
        path = _saved_json()
        path.parent.mkdir(parents=True, exist_ok=True)
        Calibration(_identity(), machine).save(path)
    return machine


def describe(machine: Machine) -> str:
    """The measurement in one line."""
    return (
        f"splatting takes {machine.splatting:.2f} and images {machine.imaging:.2f} times as long as on the reference"
        f" machine; {machine.cores:.1f} of {len(usable_cores())} cores work at once"
    )


def _identity() -> dict[str, Any]:
    return {"version": VERSION, "instruction_set": _native.instruction_set(), "cores": len(usable_cores())}


def _measure_least(work: Callable[[], None], times: int) -> tuple[float, float]:
    """Least processor time of several repetitions, s, and the largest number of cores that worked at once."""
    work()
    cpu_s, cores = [], []
    for _ in range(times):
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        cpu_s.append(cpu)
        cores.append(cpu / wall)
    return min(cpu_s), max(cores)


def _prepare_splatting() -> Callable[[], None]:
    """One training step of a ball of Gaussians about as dense as a plant on its table."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(N_GAUSSIANS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    gaussians = Gaussians(
        (directions * np.cbrt(rng.random((N_GAUSSIANS, 1)))).astype(np.float32),
        rng.normal(size=(N_GAUSSIANS, 4)).astype(np.float32),
        np.log(rng.uniform(0.01, 0.03, (N_GAUSSIANS, 3))).astype(np.float32),
        rng.normal(0.5, 1.5, N_GAUSSIANS).astype(np.float32),
        rng.normal(0, 0.3, (N_GAUSSIANS, 4, 3)).astype(np.float32),
    )
    width, height = SPLATTED_PX
    pose = np.concatenate([np.eye(3), [[0.0], [0.0], [3.0]]], axis=1)
    camera = Camera("made", width, height, 1.1 * width, 1.1 * width, width / 2, height / 2, pose)
    target = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    adam, statistics = AdamState.zeros(gaussians), DensityStatistics.zeros(N_GAUSSIANS)
    still = LearningRates(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def step() -> None:
        train_step(gaussians, adam, statistics, camera, target, sh_degree=1, learning_rates=still)

    return step


def _prepare_features() -> Callable[[], None]:
    """Features of an image of blobs of all sizes."""
    import cv2

    rng = np.random.default_rng(0)
    width, height = FEATURES_PX
    image = np.zeros((height, width), np.float32)
    for side in (8, 16, 32, 64, 128):
        coarse = rng.random((height // side + 1, width // side + 1)).astype(np.float32)
        image += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    grey = cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    finder = cv2.SIFT.create(2048)

    def find() -> None:
        finder.detectAndCompute(grey, None)

    return find


def _saved_json() -> Path:
    """The user's file, below $XDG_CACHE_HOME or ~/.cache.

    Raises:
        RuntimeError: this user has no home.
    """
    root = os.environ.get("XDG_CACHE_HOME", "")
    folder = Path(root) if Path(root).is_absolute() else Path.home() / ".cache"
    return folder / "cotton3dg" / "calibration.json"
