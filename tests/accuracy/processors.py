# SPDX-License-Identifier: Apache-2.0
"""How far a row depends on the make of the processor: one film measured as on processors of other kinds.

    python tests/accuracy/processors.py PLANT FOLDER [--preset draft] [--from sfm|train|masks]

A library chooses its instructions when it is loaded, and can be told to do without the newer ones: so an old processor
is a set of environment variables. PLANT has been through `run` with the preset; each of the others starts with its
stages before `--from` and is measured in a folder of its own in FOLDER. Prints which stages come out with other bits,
and what that makes of the traits; beside it another seed of the training, as a yardstick. Nothing in PLANT changes.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markdown_tables import markdown

from cotton3dg.core.machine import usable_cores
from cotton3dg.io.colmap import read_cameras, read_points
from cotton3dg.io.ply import read_gaussians
from cotton3dg.io.saving import file_sha256
from cotton3dg.io.tables import parse_number, read_rows
from cotton3dg.options import PRESET_VALUES
from cotton3dg.stage import STAGES
from cotton3dg.workspace import Workspace

LIBRARIES = {
    "cotton3dg": {"COTTON3DG_ISA": "baseline"},
    "OpenCV": {"OPENCV_CPU_DISABLE": "AVX512_SKX,AVX2,FMA3,AVX"},
    "numpy": {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4", "OPENBLAS_CORETYPE": "Nehalem"},
    "torch": {"ATEN_CPU_CAPABILITY": "default", "MKL_CBWR": "COMPATIBLE"},
    "glibc": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F"},
}
"""Who can be told to compute as on a processor of 2008: variables that tell it."""
TRAITS = ("boll_count", "boll_volume_cm3", "plant_height_cm", "canopy_size_cm")


def measured(run: Workspace, preset: str, environment: dict[str, str], *options: str) -> None:
    """Run a plant, in a process that sees another processor."""
    tool = Path(sys.executable).with_name("cotton3dg")
    command = [tool, "run", run.root, "--preset", preset, "--no-report", *options]
    log = run.root.with_name(f"{run.root.name}.log")
    with log.open("w", encoding="utf-8") as file:
        done = subprocess.run(
            command, check=False, stdout=file, stderr=subprocess.STDOUT, env={**os.environ, **environment}
        )
    if done.returncode:
        sys.exit(f"{run.root.name} failed; see {log}")


def bits(run: Workspace) -> dict[str, Any]:
    """Stage -> something that is equal only if what later stages read of it has the same bits."""
    sparse = run.undistorted / "sparse"
    cameras = np.array([camera.cam_from_scene for camera in read_cameras(sparse)])
    return {
        "frames": [file_sha256(file) for file in sorted(run.folder("frames").glob("*.jpg"))],
        "sfm": (cameras.tobytes(), np.asarray(read_points(sparse)[0]).tobytes()),
        "train": read_gaussians(run.gaussians_ply).sha256(),
        "masks": [file_sha256(file) for file in sorted(run.folder("masks").rglob("*.png"))],
        "cluster": file_sha256(run.labels_npy),
    }


def change_pct(value: float, reference: float) -> float:
    """NaN without a reference: a plant without bolls has no volume."""
    return 100 * (value / reference - 1) if reference else np.nan


def compared(name: str, run: Workspace, with_: Workspace) -> dict[str, Any]:
    own, other = bits(run), bits(with_)
    changed = next((stage for stage in own if own[stage] != other[stage]), "")
    mine, theirs = (read_rows(each.traits_csv)[0] for each in (run, with_))
    row: dict[str, Any] = {"computed as of 2008": name, "first other bits": changed or "none"}
    for trait in TRAITS:
        value, reference = parse_number(mine[trait]), parse_number(theirs[trait])
        row[trait] = value
        if trait != "boll_count":
            row[f"{trait.split('_')[-2]}, %"] = change_pct(value, reference)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plant", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--preset", choices=PRESET_VALUES, default="draft")
    parser.add_argument("--from", dest="first", choices=("frames", "sfm", "train", "masks"), default="frames")
    parser.add_argument("--only", nargs="*", help="names of libraries, `all` or `seed`; default: every one")
    wanted = parser.parse_args()
    plant = Workspace(wanted.plant)
    others: dict[str, tuple[dict[str, str], list[str]]] = {
        "nobody": ({}, []),
        **{name: (variables, []) for name, variables in LIBRARIES.items()},
        "all": ({key: value for each in LIBRARIES.values() for key, value in each.items()}, []),
        "seed": ({}, ["--set", "train.seed=1"]),
    }
    rows = []
    for name, (environment, options) in others.items():
        if wanted.only and name not in wanted.only:
            continue
        (wanted.folder / name).mkdir(parents=True, exist_ok=True)
        run = Workspace(wanted.folder / name)
        if not run.traits_csv.is_file():
            plant.share_inputs(run)
            if plant.options_file.is_file():
                shutil.copyfile(plant.options_file, run.options_file)
            for stage in STAGES[: STAGES.index(wanted.first)]:
                plant.share_result(stage, run)
            measured(run, wanted.preset, environment, *options)
        rows.append(compared(name, run, plant))
    print(f"{plant.root.name}, from {wanted.first} on, {len(usable_cores())} cores\n\n{markdown(pd.DataFrame(rows))}")


if __name__ == "__main__":
    main()
