# SPDX-License-Identifier: Apache-2.0
"""Simulated plants, filmed and measured by the command line, side by side."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import TypeVar

from cotton3dg.core.machine import usable_cores

Item = TypeVar("Item")


def film_and_run(plant: Path, film: str, preset: str, until: str = "traits") -> int:
    """Exit code of the first command that failed, or 0; what they print goes to a log beside the plant's folder.

    Args:
        film: options of `cotton3dg simulate`; not used if the plant has its video.
        until: the last stage.
    """
    tool = Path(sys.executable).with_name("cotton3dg")
    plant.parent.mkdir(parents=True, exist_ok=True)
    commands = [["run", str(plant), "--preset", preset, "--no-report", "--until", until]]
    if not (plant / "video.mp4").is_file():
        shutil.rmtree(plant, ignore_errors=True)  # simulate would not touch what it left when it was killed
        commands.insert(0, ["simulate", str(plant), *film.split()])
    with plant.with_name(f"{plant.name}.log").open("a", encoding="utf-8") as log:
        for command in commands:
            code = subprocess.run([tool, *command], check=False, stdout=log, stderr=subprocess.STDOUT).returncode
            if code:
                return code
    return 0


def side_by_side(jobs: int, work: Callable[[Item], int], items: Iterable[Item]) -> list[int]:
    """What the work returns for each item; the jobs share the cores that this process may use."""
    cores: SimpleQueue[list[int]] = SimpleQueue()
    for job in range(jobs):
        cores.put(usable_cores()[job::jobs] or usable_cores())
    with ThreadPoolExecutor(jobs, initializer=lambda: os.sched_setaffinity(0, cores.get())) as pool:
        return list(pool.map(work, items))
