"""Find the bolls in images from around the plant, or take over masks that were made elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import MaskSet
from ..core.outcome import StageOutcome
from ..core.progress import Progress, silent
from ..core.scene import Camera
from ..errors import BadInput
from ..files.annotations import read_masks, undistorted_ids
from ..files.colmap import read_cameras, read_points
from ..files.images import read_image, write_ids
from ..options import MasksOptions, as_dict
from ..plant.detect_lint import detect_lint
from ..plant.views import azimuths, evenly_spaced, fit_orbit
from ..workspace import Workspace, json_text

VERSION = 2

VOTING_VIEWS = 36
"""Least views, where there are as many, that vote on where lint is, however few get masks."""

NOTHING_FOUND = (
    "no boll was found in any image; if the plant has open bolls, look at sfm/undistorted/images: the plant should "
    "stand in the middle of the orbit with its lint lit; or draw masks and use --backend import"
)


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted, workspace.masks_input]


def run(workspace: Workspace, options: MasksOptions, progress: Progress = silent) -> StageOutcome:
    """Writes masks/<image>.png with 16-bit ids at the size of the undistorted image, and masks.json."""
    cameras = read_cameras(workspace.require(workspace.undistorted / "sparse", "sfm"))
    if options.backend == "import":
        masks = imported(workspace, options, cameras)
    else:
        masks = detected(workspace, options, cameras, progress)
    counts = {name: len(np.unique(ids[ids > 0])) for name, ids in masks.ids.items()}
    document = {
        "backend": options.backend,
        "options": as_dict(options),
        "images": [
            {"name": name, "instances": counts[name], "scores": masks.scores.get(name, {})} for name in sorted(counts)
        ],
    }
    with workspace.writing("masks") as folder:
        for name, ids in masks.ids.items():
            write_ids(folder / workspace.mask_png(name).name, ids)
        (folder / workspace.masks_json.name).write_text(json_text(document), encoding="utf-8")
    summary = {
        "images": len(counts),
        "masks": sum(counts.values()),
        "masks_per_image": round(float(np.mean(list(counts.values()))), 1),
        "backend": options.backend,
    }
    if summary["masks"]:
        return StageOutcome(summary)
    return StageOutcome(summary, ("no_masks",), (NOTHING_FOUND,))


def detected(workspace: Workspace, options: MasksOptions, cameras: Sequence[Camera], progress: Progress) -> MaskSet:
    """Masks of the `lint` back end on views evenly spaced around the plant."""
    if len(cameras) < 2:
        raise BadInput("only one image has a pose; bolls are found from several sides, so film a full turn")
    orbit = fit_orbit(cameras)
    angles = azimuths(cameras, orbit)
    voting = evenly_spaced(angles, max(options.views, VOTING_VIEWS))
    painted = {cameras[voting[i]].name for i in evenly_spaced(angles[voting], options.views)}
    voters = [cameras[i] for i in voting]
    images = [read_image(workspace.undistorted_image(camera.name)) for camera in voters]
    points = read_points(workspace.undistorted / "sparse")[0]
    return detect_lint(images, voters, orbit, points, painted, progress)


def imported(workspace: Workspace, options: MasksOptions, cameras: Sequence[Camera]) -> MaskSet:
    """The user's masks, fitted to the undistorted images.

    Raises:
        BadInput: masks of images that do not exist, or of another shape than these.
    """
    source = workspace.root / options.source if options.source else workspace.masks_input
    found = read_masks(source)
    by_stem = {Path(camera.name).stem: camera for camera in cameras}
    unknown = sorted(found.ids.keys() - by_stem.keys())
    if unknown:
        raise BadInput(
            f"{len(unknown)} masks, e.g. {unknown[0]}, belong to no image with a pose "
            f"(e.g. {next(iter(by_stem))}); name masks like their images"
        )
    ids: dict[str, NDArray[np.uint16]] = {}
    for stem, mask in found.ids.items():
        camera = by_stem[stem]
        ids[camera.name] = undistorted_ids(stem, mask, camera, workspace.sfm_model)
    return MaskSet(ids, {by_stem[stem].name: scores for stem, scores in found.scores.items()})
