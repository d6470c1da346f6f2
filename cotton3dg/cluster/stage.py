"""Reconcile the views' selections into the bolls of the plant."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from ..core.runs import Progress, StageOutcome, silent
from ..errors import BadInput
from ..gaussians.appearance import boll_colours
from ..io.colmap import read_cameras
from ..io.images import write_image
from ..io.ply import read_gaussians, recolour, write_gaussians
from ..options import ClusterOptions
from ..schemas.bolls import boll_labels, describe_bolls, read_lifted
from ..schemas.masks import MasksInfo
from ..stage import Cost, Stage, twice_the_model
from ..workspace import Workspace
from .boll_masks import assign_masks, weigh_scores
from .boll_shape import flag_close
from .consensus import merge_views
from .dbscan import cluster_objects
from .view_picture import draw_views


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted / "sparse", workspace.gaussians_ply, workspace.selections_npz, workspace.masks_json]


def run(workspace: Workspace, options: ClusterOptions, progress: Progress = silent) -> StageOutcome:
    """Writes bolls.json, labels.npy (boll of each Gaussian, 0 = none), bolls.ply, coloured by boll, and views.jpg, the
    bolls by one view beside those by all; on request also one PLY for each boll."""
    lifted = read_lifted(workspace.require(workspace.selections_npz, "segment"))
    gaussians = read_gaussians(workspace.require(workspace.gaussians_ply, "train"))
    if lifted.gaussians_sha256 != gaussians.sha256():
        raise BadInput("selections.npz belongs to another model than gaussians.ply; run `cotton3dg segment` again")
    cameras = read_cameras(workspace.require(workspace.undistorted / "sparse", "sfm"))
    # People hold cameras upright on the whole; that gives the top and the bottom well enough to number the bolls.
    up = -np.mean([camera.rotation[1] for camera in cameras], axis=0)
    masks = MasksInfo.load_if_there(workspace.masks_json)
    together = masks is not None and masks.together
    if options.method == "dbscan":
        bolls = cluster_objects(lifted, gaussians.means, up, options.dbscan.eps, options.dbscan.min_samples)
    else:
        bolls = merge_views(lifted, gaussians.means, up, together=together)
    bolls = flag_close(bolls)
    left_out = masks.left_out if masks is not None else ()
    labels = boll_labels(bolls, len(gaussians))
    bolls = assign_masks(bolls, lifted, labels)
    if masks is not None and masks.together:
        bolls = weigh_scores(bolls, masks.scores())
    with workspace.writing("cluster") as folder:
        describe_bolls(bolls, lifted.gaussians_sha256, left_out).save(folder / workspace.bolls_json.name)
        np.save(folder / workspace.labels_npy.name, labels)
        write_gaussians(folder / workspace.bolls_ply.name, recolour(gaussians, boll_colours(labels)))
        for boll in bolls if options.boll_plys else []:
            write_gaussians(folder / workspace.boll_ply(boll.boll_id).name, gaussians[boll.indices])
        if (picture := draw_views(gaussians, cameras, lifted, bolls)) is not None:
            write_image(folder / workspace.views_jpg.name, picture)
    doubtful = sum(bool(boll.flags) for boll in bolls)
    summary = {
        "bolls": len(bolls),
        "boll_gaussians": int((labels > 0).sum()),
        "median_views": float(np.median([len(boll.views) for boll in bolls])) if bolls else 0.0,
        "doubtful_bolls": doubtful,
    }
    if bolls:
        return StageOutcome(summary)
    seen = "no view shows a boll" if options.method == "dbscan" else "no boll was seen alike by two views"
    return StageOutcome(summary, ("no_bolls",), (f"{seen}; look at masks/ and at --views of masks",))


STAGE: Final = Stage(
    "cluster", version=11, inputs=inputs, run=run, cost=lambda work: Cost(0.0, 0.5), disk_bytes=twice_the_model
)
