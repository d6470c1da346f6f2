# SPDX-License-Identifier: Apache-2.0
"""Finds the bolls in images from around the plant, or imports masks."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Final

import numpy as np

from ..core.machine import on_all_cores
from ..core.runs import Progress, StageOutcome, silent
from ..io.colmap import read_cameras, read_points
from ..io.images import read_image, write_ids
from ..io.saving import file_sha256
from ..option_rules import as_dict
from ..options import MasksOptions
from ..schemas.masks import MaskedImage, MasksInfo
from ..schemas.network_maps import write_maps
from ..stage import EITHER, FILE, FOLDER, Cost, Stage, Work
from ..workspace import Workspace
from .backends import BACK_ENDS, NO_DETECTION, NOTHING_FOUND, Plant
from .bolls import SHIPPED_FILE, input_size

MASK_BYTES: Final = 2**19
"""Generous size of the masks and maps of one image on the disk."""
WEIGHTS: Final = ("weights", "detector")
"""Options of back ends that name networks."""
NAMES: Final = {
    "bolls.weights": FILE,
    "import.source": EITHER,
    "yolo.weights": FILE,
    "sam.weights": FOLDER,
    "sam.prompts": FILE,
    "grounded-sam.weights": FOLDER,
    "grounded-sam.detector": FOLDER,
}


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted, workspace.masks_input]


def also_reads(workspace: Workspace, options: MasksOptions) -> list[Path]:
    """The network that comes with the program, if the back end uses it for masks or for prompts."""
    finds_bolls = options.backend == "bolls" or (options.backend == "sam" and not options.sam.prompts)
    own_network = options.backend == "bolls" and options.bolls.weights
    return [SHIPPED_FILE] if finds_bolls and not own_network else []


def run(workspace: Workspace, options: MasksOptions, progress: Progress = silent) -> StageOutcome:
    """Writes masks/<image>.png with 16-bit ids at the size of the undistorted image, and masks.json. The bolls' network
    also writes its maps, masks/<image>.npz."""
    start = time.perf_counter()
    plant = load_plant(workspace)
    found = BACK_ENDS[options.backend](plant, options, progress)
    seconds, masks = time.perf_counter() - start, found.masks
    counts = {name: len(np.unique(ids[ids > 0])) for name, ids in masks.ids.items()}
    info = MasksInfo(
        options.backend,
        as_dict(options),
        _weights_sha256(workspace, options),
        seconds_per_image=round(seconds / max(len(counts), 1), 3),
        images=tuple(
            MaskedImage(name, counts[name], {str(k): score for k, score in masks.scores.get(name, {}).items()})
            for name in sorted(counts)
        ),
        maps=bool(found.maps),
    )
    with workspace.writing("masks") as folder:
        on_all_cores(lambda name: write_ids(folder / workspace.mask_png(name).name, masks.ids[name]), masks.ids)
        on_all_cores(lambda name: write_maps(folder / workspace.maps_npz(name).name, found.maps[name]), found.maps)
        info.save(folder / workspace.masks_json.name)
    summary = {
        "images": len(counts),
        "masks": sum(counts.values()),
        "masks_per_image": round(float(np.mean(list(counts.values()))), 1),
        "backend": options.backend,
    }
    if summary["masks"]:
        return StageOutcome(summary, (), found.notes)
    return StageOutcome(summary, ("no_masks",), (NOTHING_FOUND.get(options.backend, NO_DETECTION), *found.notes))


def load_plant(workspace: Workspace) -> Plant:
    """The data of a plant that a back end uses."""
    sparse = workspace.require(workspace.undistorted / "sparse", "sfm")
    cameras = read_cameras(sparse)
    return Plant(
        cameras,
        photo=lambda name: read_image(workspace.undistorted_image(name)),
        points=read_points(sparse)[0],
        filmed=workspace.sfm_model,
        own_masks=workspace.masks_input,
        file=workspace.named_file,
    )


def _weights_sha256(workspace: Workspace, options: MasksOptions) -> dict[str, str]:
    """Which weights made the masks."""
    sums: dict[str, str] = {}
    chosen = as_dict(options)
    for text in (chosen[name] for name in WEIGHTS if chosen.get(name)):
        path = workspace.named_file(text)
        files = [path] if path.is_file() else sorted([*path.glob("*.safetensors"), *path.glob("*.bin")])
        sums |= {f"{path.name}/{file.name}" if path.is_dir() else file.name: file_sha256(file) for file in files}
    return sums


def _disk_bytes(_: Workspace, options: MasksOptions) -> float:
    return options.views * MASK_BYTES


def _cost(work: Work) -> Cost:
    """The cost of `bolls` depends on the size of the images. That of other back ends depends on the user's network;
    this suits a small one."""
    width, height = work.size
    image_mp = width * height / 1e6
    if work.options["masks"].backend == "bolls":
        return Cost(0.46 * math.prod(input_size(height, width)) / 1e6 * work.views)
    return Cost((0.16 + 0.41 * image_mp) * work.views)


STAGE: Final = Stage(
    "masks",
    version=23,
    inputs=inputs,
    run=run,
    cost=_cost,
    disk_bytes=_disk_bytes,
    names=NAMES,
    also_reads=also_reads,
)
