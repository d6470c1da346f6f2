# SPDX-License-Identifier: Apache-2.0
"""How long a field takes on other machines: a simulation from one plant's records, as Markdown on standard output.

    python tests/benchmarks/throughput.py PLANT_DIR [--plants 50] [--cores 8 32] [--spread 0.15]

PLANT_DIR was run from the video on an otherwise idle machine whose cores the run could all use. Of each stage the
records have seconds and processor time, so that what only one core can do is known: of c seconds of processor time
that took w seconds on n cores it is (n w - c) / (n - 1). The plants differ by a lognormal factor; each job takes the
next one when it is done, as `batch` and Slurm do. What is not in it: cores that slow each other down for want of
memory bandwidth, shared disks, and the wait in a cluster's queue.
"""

from __future__ import annotations

import argparse
import heapq
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cotton3dg.core.machine import usable_cores
from cotton3dg.stage import STAGES, Cost
from cotton3dg.workspace import Workspace

PROGRAM_S = 3.0
"""Start of the program and the page of the plant, which no record has."""


def stage_costs(plant: Workspace, measured_on: int) -> list[Cost]:
    """What each stage of a finished plant took, parted into what cores share and what one must do alone."""
    costs = []
    for record in map(plant.read_record, STAGES):
        if record is None:
            raise SystemExit(f"{plant.root}: run the plant first")
        alone = (measured_on * record.seconds - record.cpu_seconds) / max(measured_on - 1, 1)
        alone = min(max(alone, 0.0), record.cpu_seconds)
        costs.append(Cost(record.cpu_seconds - alone, alone))
    return costs


def makespan_s(plants_s: Sequence[float], jobs: int) -> float:
    """Seconds until the last of the plants is done, when each of the jobs takes the next one."""
    free_at = [0.0] * jobs
    for plant_s in plants_s:
        heapq.heappush(free_at, heapq.heappop(free_at) + plant_s)
    return max(free_at)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plant", type=Path)
    parser.add_argument("--plants", type=int, default=50)
    parser.add_argument("--cores", type=int, nargs="+", default=[8, 32])
    parser.add_argument("--spread", type=float, default=0.15, help="standard deviation of the plants' factors, log")
    arguments = parser.parse_args()
    plant = Workspace(arguments.plant)
    costs = stage_costs(plant, len(usable_cores()))
    memory_mib = max(record.peak_memory_mib for record in map(plant.read_record, STAGES) if record)
    disk_mib = sum(path.stat().st_size for path in plant.root.rglob("*") if path.is_file()) / 2**20
    factors = np.exp(np.random.default_rng(0).normal(0, arguments.spread, arguments.plants))
    print(
        f"One plant: {sum(cost.cpu_s for cost in costs):.0f} s of processor time, {memory_mib:.0f} MiB, "
        f"{disk_mib:.0f} MiB of disk.\n"
    )
    print("| cores | jobs at a time | cores a job | one plant | all | memory |\n|---|---|---|---|---|---|")
    for cores in arguments.cores:
        for share in (1, 2, 4):
            one_s = sum(cost.seconds(share) for cost in costs) + PROGRAM_S
            all_s = makespan_s(list(one_s * factors), cores // share)
            memory_gib = cores // share * memory_mib / 1024
            print(
                f"| {cores} | {cores // share} | {share} | {one_s / 60:.1f} min | {all_s / 60:.0f} min "
                f"| {memory_gib:.0f} GiB |"
            )


if __name__ == "__main__":
    main()
