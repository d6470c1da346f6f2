"""Lift the boll masks of single images onto the Gaussians."""

from __future__ import annotations

from pathlib import Path

from ..core.outcome import StageOutcome
from ..core.progress import Progress, silent
from ..errors import BadInput
from ..files.bolls import write_lifted
from ..files.colmap import read_cameras
from ..files.images import fitted_size, read_ids
from ..files.ply import read_gaussians
from ..options import SegmentOptions
from ..plant.lift import ViewWeights, lift, resized_ids, rim_width_px, with_rim, within_orbit
from ..splat.metrics import focus
from ..splat.ops import accumulate_weights
from ..workspace import Workspace

VERSION = 1


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted / "sparse", workspace.gaussians_ply, workspace.folder("masks")]


def run(workspace: Workspace, options: SegmentOptions, progress: Progress = silent) -> StageOutcome:
    """Writes selections.npz: which Gaussians each mask holds, and what each view sees of them."""
    gaussians = read_gaussians(workspace.require(workspace.gaussians_ply, "train"))
    cameras = read_cameras(workspace.require(workspace.undistorted / "sparse", "sfm"))
    workspace.require(workspace.folder("masks"), "masks")
    masked = [camera for camera in cameras if workspace.mask_png(camera.name).exists()]
    id_images = []
    for camera in masked:
        path = workspace.mask_png(camera.name)
        ids = read_ids(path)
        if ids.shape != (camera.height, camera.width):
            raise BadInput(
                f"{path.name} is {ids.shape[1]}x{ids.shape[0]} px, its image is {camera.width}x{camera.height}; "
                "masks must fit the undistorted images"
            )
        id_images.append(resized_ids(ids, *fitted_size(camera.width, camera.height, options.max_side)))
    rim_px = rim_width_px(id_images)
    views = []
    for done, (camera, ids) in enumerate(zip(masked, id_images, strict=True)):
        progress(done, len(masked), camera.name)
        height, width = ids.shape
        weights = accumulate_weights(gaussians, camera.resized(width, height), with_rim(ids, rim_px))
        views.append(ViewWeights(camera.name, weights.total, weights.rows, weights.ids, weights.weights))
    progress(len(masked), len(masked))
    lifted = lift(views, within_orbit(gaussians.means, cameras, *focus(cameras)), gaussians.sha256())
    with workspace.writing("segment") as folder:
        write_lifted(folder / workspace.selections_npz.name, lifted)
    summary = {
        "views": len(lifted.views),
        "masks": len(lifted.selections),
        "candidates": len(lifted.candidates),
        "gaussians": len(gaussians),
        "rim_px": rim_px,
    }
    if lifted.selections:
        return StageOutcome(summary)
    return StageOutcome(
        summary, ("no_bolls",), ("no mask holds any Gaussian; look at masks/, try another --backend or import masks",)
    )
