# SPDX-License-Identifier: Apache-2.0
"""Finds the bolls of the plant: by votes that meet in space, or by the masks of single views."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import BollInstance
from ..core.machine import on_all_cores
from ..core.runs import Progress, StageOutcome, silent
from ..core.scene import Camera, Float64, Gaussians
from ..errors import BadInput, BadUsage
from ..gaussians.appearance import boll_colours
from ..geometry.camera_orbit import find_up
from ..io.colmap import read_cameras
from ..io.images import read_ids, write_ids, write_image
from ..io.ply import read_gaussians, recolour, write_gaussians
from ..options import ClusterOptions
from ..schemas.bolls import boll_labels, describe_bolls, read_lifted, read_lint_share
from ..schemas.masks import MasksInfo
from ..schemas.network_maps import read_maps
from ..schemas.scale import ScaleInfo
from ..stage import Cost, Stage, Work, twice_the_model
from ..workspace import Workspace
from .boll_shape import flag_close
from .consensus import merge_views
from .dbscan import cluster_objects
from .locate_bolls import Located, locate_bolls
from .same_boll import SCORE_FILE
from .view_objects import assign_masks
from .view_picture import draw_views

NO_LINT: Final = (
    "no boll was found in any image; if the plant has open bolls, look at sfm/undistorted/images: the plant "
    "should stand in the middle of the orbit with its lint lit; or draw masks and use masks --backend import"
)
SIZE_STEP: Final = 1.05
"""Ratio of the steps to which the length of a scene unit is rounded. A new measurement of the scale usually changes it
by less, and then the bolls are still up to date; bolls differ in size by far more."""


def inputs(workspace: Workspace) -> list[Path]:
    return [
        workspace.undistorted / "sparse",
        workspace.gaussians_ply,
        workspace.lint_share_npz,
        workspace.selections_npz,
        workspace.folder("masks"),
    ]


def parts(workspace: Workspace, _: ClusterOptions) -> dict[str, str]:
    """The length of a scene unit, from the scale."""
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


def run(workspace: Workspace, options: ClusterOptions, progress: Progress = silent) -> StageOutcome:
    """Writes bolls.json, labels.npy (boll of each Gaussian, 0 = none), bolls.ply, coloured by boll, and views.jpg, the
    bolls by one view beside those by all; on request also one PLY for each boll. Bolls by votes are drawn into the
    images, too: images/<image>.png with 16-bit ids."""
    gaussians = read_gaussians(workspace.require(workspace.gaussians_ply, "train"))
    cameras = read_cameras(workspace.require(workspace.undistorted / "sparse", "sfm"))
    up = find_up(cameras)
    masks = MasksInfo.load_if_there(workspace.masks_json)
    if workspace.lint_share_npz.is_file():
        located = _by_votes(workspace, options, gaussians, cameras, up)
    else:
        located = Located(_by_masks(workspace, options, gaussians, up))
    bolls = flag_close(located.bolls)
    labels = boll_labels(bolls, len(gaussians))
    with workspace.writing("cluster") as folder:
        info = describe_bolls(bolls, gaussians.sha256(), located.left_out, located.halves, located.joining)
        info.save(folder / workspace.bolls_json.name)
        np.save(folder / workspace.labels_npy.name, labels)
        write_gaussians(folder / workspace.bolls_ply.name, recolour(gaussians, boll_colours(labels)))
        for boll in bolls if options.boll_plys else []:
            write_gaussians(folder / workspace.boll_ply(boll.boll_id).name, gaussians[boll.indices])
        if (picture := _draw(workspace, gaussians, cameras, masks, labels)) is not None:
            write_image(folder / workspace.views_jpg.name, picture)
        if located.images:
            (folder / workspace.boll_images.name).mkdir()
            on_all_cores(
                lambda name: write_ids(
                    folder / workspace.boll_images.name / workspace.mask_png(name).name, located.images[name]
                ),
                located.images,
            )
    doubtful = sum(bool(boll.flags) for boll in bolls)
    summary = {
        "bolls": len(bolls),
        "boll_gaussians": int((labels > 0).sum()),
        "median_views": float(np.median([len(boll.views) for boll in bolls])) if bolls else 0.0,
        "doubtful_bolls": doubtful,
    }
    if bolls:
        return StageOutcome(summary)
    alike = "no view shows a boll" if options.method == "dbscan" else "no boll was seen alike by two views"
    seen = NO_LINT if masks and masks.maps else alike
    return StageOutcome(summary, ("no_bolls",), (f"{seen}; look at masks/ and at --views of masks",))


def _by_votes(
    workspace: Workspace, options: ClusterOptions, gaussians: Gaussians, cameras: Sequence[Camera], up: Float64
) -> Located:
    if options.method != "votes":
        raise BadUsage(f"--method {options.method} needs lifted masks; run `cotton3dg segment --method lift` first")
    shares = read_lint_share(workspace.lint_share_npz, gaussians)
    seen = [camera for camera in cameras if workspace.maps_npz(camera.name).is_file()]
    if not seen:
        raise BadInput("lint_share.npz belongs to other masks than those in masks/; run `cotton3dg segment` again")
    maps = on_all_cores(lambda camera: read_maps(workspace.maps_npz(camera.name)), seen)
    return locate_bolls(maps, seen, gaussians, shares, up, read_unit_length(workspace))


def _by_masks(workspace: Workspace, options: ClusterOptions, gaussians: Gaussians, up: Float64) -> list[BollInstance]:
    lifted = read_lifted(workspace.require(workspace.selections_npz, "segment"))
    if lifted.gaussians_sha256 != gaussians.sha256():
        raise BadInput("selections.npz belongs to another model than gaussians.ply; run `cotton3dg segment` again")
    if options.method == "dbscan":
        bolls = cluster_objects(lifted, gaussians.means, up, options.dbscan.eps, options.dbscan.min_samples)
    else:
        bolls = merge_views(lifted, gaussians.means, up)
    return assign_masks(bolls, lifted, boll_labels(bolls, len(gaussians)))


def _draw(
    workspace: Workspace,
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    masks: MasksInfo | None,
    labels: NDArray[np.int32],
) -> NDArray[np.uint8] | None:
    """Bolls by the image with the most masks, beside those by all; None without any mask."""
    counts = {image.name: image.instances for image in masks.images} if masks else {}
    masked = [camera for camera in cameras if counts.get(camera.name)]
    if not masked or len(cameras) < 2:
        return None
    chosen = max(masked, key=lambda camera: counts[camera.name])
    return draw_views(gaussians, cameras, chosen, read_ids(workspace.mask_png(chosen.name)), labels)


def _cost(work: Work) -> Cost:
    """The cost of casting votes and of drawing the bolls, for each image, and of the search for bolls."""
    if work.options["segment"].method != "lint":
        return Cost(0.0, 0.5)
    return Cost((0.05 + 0.07 * work.size[0] * work.size[1] / 1e6) * work.views, 2.0)


STAGE: Final = Stage(
    "cluster",
    version=17,
    inputs=inputs,
    run=run,
    cost=_cost,
    disk_bytes=twice_the_model,
    also_reads=lambda *_: [SCORE_FILE],
    parts=parts,
)
