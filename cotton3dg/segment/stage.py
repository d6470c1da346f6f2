# SPDX-License-Identifier: Apache-2.0
"""Finds for each Gaussian how much it is lint, or which masks hold it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.runs import Progress, StageOutcome, silent
from ..core.scene import Camera, Gaussians
from ..errors import BadInput
from ..gaussians.metrics import to_uint8
from ..geometry.camera_orbit import fit_orbit, within_orbit
from ..io.colmap import read_cameras
from ..io.images import fit_size, read_ids, write_image
from ..io.ply import read_gaussians, write_gaussians
from ..options import SegmentOptions
from ..schemas.bolls import write_lifted, write_lint_share
from ..schemas.masks import MasksInfo
from ..schemas.network_maps import read_maps
from ..schemas.segment import SegmentInfo
from ..stage import Cost, Stage, Work, twice_the_model
from ..workspace import Workspace
from .lift import resize_ids
from .lint_share import gather_lint
from .segment import segmented

LEAST_LIFTED: Final = 0.75
"""Least share of masks that agree with those of other views about a Gaussian. Nearly all right masks do."""


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted / "sparse", workspace.gaussians_ply, workspace.folder("masks")]


def run(workspace: Workspace, options: SegmentOptions, progress: Progress = silent) -> StageOutcome:
    """Writes segment.json and the Gaussians' part in lint or masks.

    With the network's maps the stage writes lint_share.npz: how much each Gaussian is lint. From masks without maps, or
    by another method, it writes selections.npz: the Gaussians of each mask, with their weights in each view.

    The method `probability` also writes probabilities.npy and lint.ply (the Gaussians above the threshold), and for a
    few views pictures of the map, of the map over the training, and of the lint alone. `affinity` writes features.npy.
    """
    gaussians = read_gaussians(workspace.require(workspace.gaussians_ply, "train"))
    cameras = read_cameras(workspace.require(workspace.undistorted / "sparse", "sfm"))
    masks = MasksInfo.load_if_there(workspace.require(workspace.folder("masks"), "masks") / workspace.masks_json.name)
    if options.method == "lint" and masks and masks.maps:
        return _share_lint(workspace, gaussians, cameras, progress)
    masked, id_images = _masks(workspace, cameras, options)
    found = segmented(gaussians, cameras, masked, id_images, options, progress)
    with workspace.writing("segment") as folder:
        write_lifted(folder / workspace.selections_npz.name, found.lifted)
        found.info.save(folder / workspace.segment_json.name)
        if found.probabilities is not None:
            np.save(folder / workspace.probabilities_npy.name, found.probabilities)
            lint = gaussians[found.probabilities > options.probability.threshold]
            write_gaussians(folder / workspace.lint_ply.name, lint)
        if found.features is not None:
            np.save(folder / workspace.features_npy.name, found.features)
        for name, image in found.maps.items():
            write_image(
                folder / workspace.segment_picture("probability", name).name,
                np.repeat(to_uint8(image)[..., None], 3, axis=2),
            )
        for name, picture in found.over_training.items():
            write_image(folder / workspace.segment_picture("training", name).name, picture)
        for name, picture in found.lint_alone.items():
            write_image(folder / workspace.segment_picture("lint", name).name, picture)
    summary = {
        "views": len(found.lifted.views),
        "masks": len(found.lifted.selections),
        "candidates": len(found.lifted.candidates),
        "gaussians": len(gaussians),
    }
    if not found.lifted.selections:
        remedy = "look at masks/, try another --backend or import masks"
        return StageOutcome(summary, ("no_bolls",), (f"no mask holds any Gaussian; {remedy}",))
    drawn = sum(len(np.unique(ids[ids > 0])) for ids in id_images)
    if options.method == "affinity" or summary["masks"] >= LEAST_LIFTED * drawn:  # affinity takes a few views only
        return StageOutcome(summary)
    warning = (
        f"only {summary['masks']} of {drawn} masks agree with those of other views about any part of the plant; look "
        "whether masks/ are of this plant and named like its images"
    )
    return StageOutcome(summary, ("masks_misfit",), (warning,))


def _share_lint(
    workspace: Workspace, gaussians: Gaussians, cameras: Sequence[Camera], progress: Progress
) -> StageOutcome:
    seen = [camera for camera in cameras if workspace.maps_npz(camera.name).is_file()]
    maps = [read_maps(workspace.maps_npz(camera.name)) for camera in seen]
    allowed = within_orbit(gaussians.means, cameras, fit_orbit(cameras))
    shares = gather_lint(maps, seen, gaussians, allowed, progress)
    lint = int((shares > 0.5).sum())
    with workspace.writing("segment") as folder:
        write_lint_share(folder / workspace.lint_share_npz.name, shares, gaussians.sha256())
        SegmentInfo("lint", target=0).save(folder / workspace.segment_json.name)
    summary = {"views": len(seen), "lint_gaussians": lint, "gaussians": len(gaussians)}
    if lint:
        return StageOutcome(summary)
    return StageOutcome(summary, ("no_bolls",), ("no Gaussian is lint; look at masks/ or import masks",))


def _masks(
    workspace: Workspace, cameras: Sequence[Camera], options: SegmentOptions
) -> tuple[list[Camera], list[NDArray[np.uint16]]]:
    """The views that have masks, and these, both at the size of the renders."""
    masked, id_images = [], []
    for camera in cameras:
        path = workspace.mask_png(camera.name)
        if not path.exists():
            continue
        ids = read_ids(path)
        if ids.shape != (camera.height, camera.width):
            raise BadInput(
                f"{path.name} is {ids.shape[1]}x{ids.shape[0]} px, its image is {camera.width}x{camera.height}; "
                "masks must fit the undistorted images"
            )
        if options.target:
            ids = np.where(ids == options.target, ids, np.uint16(0))
        size = fit_size(camera.width, camera.height, options.max_side)
        masked.append(camera.resized(*size))
        id_images.append(resize_ids(ids, *size))
    return masked, id_images


def _cost(work: Work) -> Cost:
    """The cost of lifting the masks and, for the other methods, of the optimisation."""
    options: SegmentOptions = work.options["segment"]
    lifting_s = (0.06 * work.megapixels(options.max_side) + 0.19 * work.million_gaussians) * work.views
    by_probability, by_features = options.probability, options.affinity
    steps_s = {
        "probability": 0.004 * by_probability.steps * (4 / by_probability.spacing) ** 2,
        "affinity": 0.02 * by_features.feature_steps * by_features.features / 16,
    }
    return Cost(lifting_s + steps_s.get(options.method, 0.0))


STAGE: Final = Stage("segment", version=6, inputs=inputs, run=run, cost=_cost, disk_bytes=twice_the_model, splats=True)
