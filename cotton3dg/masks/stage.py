"""Find the bolls in images from around the plant, or take over masks that were made elsewhere."""

from __future__ import annotations

import hashlib
import math
import time
from pathlib import Path
from typing import Final

import numpy as np

from ..core.machine import on_all_cores
from ..core.runs import Progress, StageOutcome, silent
from ..errors import BadInput
from ..geometry.camera_orbit import fit_orbit, within_orbit
from ..io.colmap import read_cameras, read_points
from ..io.images import read_image, write_ids
from ..io.ply import read_gaussians
from ..io.saving import file_sha256
from ..option_rules import as_dict
from ..options import MasksOptions
from ..schemas.masks import MaskedImage, MasksInfo
from ..schemas.scale import ScaleInfo
from ..stage import EITHER, FILE, FOLDER, Cost, Stage, Work
from ..workspace import Workspace
from .backends import BACK_ENDS, NO_DETECTION, NOTHING_FOUND, Plant
from .bolls import SHIPPED_FILE, input_size
from .lint_edges import EDGES_FILE
from .same_boll import SCORE_FILE

SIZE_STEP: Final = 1.05
"""Ratio of the steps to which the length of a scene unit is rounded for the back ends. Bolls differ by far more, and a
new measurement of the scale changes by less, so that it does not make the masks outdated."""
MASK_BYTES: Final = 2**18
"""Of one image's masks on the disk, generous."""
WEIGHTS: Final = ("weights", "detector")
"""Options that name networks, of whichever back end has them."""
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
    """What finds bolls besides the photos: the networks and the score that come with the program, and the model."""
    if not _finds_bolls(options):
        return []
    own_network = options.backend == "bolls" and options.bolls.weights
    return [EDGES_FILE, SCORE_FILE, *([] if own_network else [SHIPPED_FILE]), workspace.gaussians_ply]


def _finds_bolls(options: MasksOptions) -> bool:
    """Whether the bolls' network finds them, for masks or for prompts."""
    return options.backend == "bolls" or (options.backend == "sam" and not options.sam.prompts)


def parts(workspace: Workspace, options: MasksOptions) -> dict[str, str]:
    """The length of a scene unit, from the scale; only the bolls' network depends on it."""
    if not _finds_bolls(options):
        return {}
    try:
        length = read_unit_length(workspace)
        content = f"{length:.4g}".encode() if length else b"none"
    except BadInput:  # the stage itself refuses the file
        content = workspace.scale_json.read_bytes()
    return {f"{workspace.scale_json.relative_to(workspace.root)}#cm_per_su": hashlib.sha256(content).hexdigest()}


def read_unit_length(workspace: Workspace) -> float | None:
    """Length of a scene unit, cm, rounded to a step of `SIZE_STEP`; None where no scale is known.

    Corrections of corners do not change it, because they refer to the bolls that were found with it.

    Raises:
        BadInput: scale.json is damaged.
    """
    info = ScaleInfo.load_if_there(workspace.scale_json)
    scale = (info.found or info).scale if info else None
    return SIZE_STEP ** round(math.log(scale.cm_per_su, SIZE_STEP)) if scale else None


def run(workspace: Workspace, options: MasksOptions, progress: Progress = silent) -> StageOutcome:
    """Writes masks/<image>.png with 16-bit ids at the size of the undistorted image, and masks.json."""
    start = time.perf_counter()
    plant = load_plant(workspace, options)
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
        together=masks.together,
        halves=masks.halves,
        left_out=masks.left_out,
    )
    with workspace.writing("masks") as folder:
        on_all_cores(lambda name: write_ids(folder / workspace.mask_png(name).name, masks.ids[name]), masks.ids)
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


def load_plant(workspace: Workspace, options: MasksOptions) -> Plant:
    """The data of a plant that a back end uses."""
    sparse = workspace.require(workspace.undistorted / "sparse", "sfm")
    cameras = read_cameras(sparse)
    # One camera alone does not have an orbit; the back ends report that.
    has_model = _finds_bolls(options) and workspace.gaussians_ply.is_file() and len(cameras) > 1
    model = read_gaussians(workspace.gaussians_ply) if has_model else None
    return Plant(
        cameras,
        photo=lambda name: read_image(workspace.undistorted_image(name)),
        points=read_points(sparse)[0],
        model=model,
        allowed=None if model is None else within_orbit(model.means, cameras, fit_orbit(cameras)),
        cm_per_su=read_unit_length(workspace) if _finds_bolls(options) else None,
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
    """`bolls` costs by what the network sees, and by the edges at full size. What another back end costs depends on the
    user's network; this suits a small one."""
    width, height = work.size
    image_mp = width * height / 1e6
    if work.options["masks"].backend == "bolls":
        seen_mp = math.prod(input_size(height, width)) / 1e6
        return Cost((0.46 * seen_mp + 0.22 * image_mp) * work.views)
    return Cost((0.16 + 0.41 * image_mp) * work.views)


STAGE: Final = Stage(
    "masks",
    version=22,
    inputs=inputs,
    run=run,
    cost=_cost,
    disk_bytes=_disk_bytes,
    names=NAMES,
    also_reads=also_reads,
    parts=parts,
)
