"""Lift the boll masks of single images onto the Gaussians."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import LiftedMasks
from ..core.outcome import StageOutcome
from ..core.progress import Progress, silent
from ..core.scene import Camera, Gaussians
from ..documents.bolls import write_lifted
from ..documents.segment import MeanIous, ReachedIous, SegmentInfo
from ..errors import BadInput
from ..files.colmap import read_cameras
from ..files.images import fit_size, read_ids, write_image
from ..files.ply import read_gaussians
from ..geometry.camera_orbit import azimuths, evenly_spaced, fit_orbit
from ..lifting.affinity import neighbour_means, sample_rays, train_features
from ..lifting.lift import (
    FOREGROUND_SHARE,
    ViewWeights,
    lift,
    mark_rim,
    resize_ids,
    rim_width_px,
    sum_seen_weights,
    vote_foreground,
    within_orbit,
)
from ..lifting.probability import REPORTED_STEPS, THRESHOLDS, mean_binary_ious, sample_view, train_probabilities
from ..lifting.prompts import PromptView, lift_prompts
from ..options import SegmentOptions
from ..splat.metrics import to_uint8
from ..splat.rasterizer import accumulate_weights, render_values
from ..workspace import Workspace
from .stage import Cost, Stage, Work, twice_the_model

SHOWN_VIEWS = 4
"""Maps of probabilities that are saved as images."""


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted / "sparse", workspace.gaussians_ply, workspace.folder("masks")]


def run(workspace: Workspace, options: SegmentOptions, progress: Progress = silent) -> StageOutcome:
    """Writes selections.npz: which Gaussians each mask holds, and what each view sees of them; and segment.json.

    The method `probability` also writes probabilities.npy and rendered maps, `affinity` features.npy.
    """
    gaussians = read_gaussians(workspace.require(workspace.gaussians_ply, "train"))
    cameras = read_cameras(workspace.require(workspace.undistorted / "sparse", "sfm"))
    workspace.require(workspace.folder("masks"), "masks")
    masked, id_images = _masks(workspace, cameras, options)
    allowed = within_orbit(gaussians.means, cameras, fit_orbit(cameras))
    info = SegmentInfo(options.method, options.target)
    foreground = features = None
    maps: dict[str, NDArray[np.float32]] = {}
    if options.method == "affinity":
        lifted, features, info = _by_features(gaussians, masked, id_images, allowed, options, progress, info)
    else:
        begin_s = time.perf_counter()
        rim_px = rim_width_px(id_images)
        views = _weights(gaussians, masked, id_images, rim_px, progress)
        info = replace(info, rim_px=rim_px, weights_seconds=time.perf_counter() - begin_s)
        least = FOREGROUND_SHARE
        if options.method == "probability" and masked:
            foreground, maps, info = _probabilities(gaussians, masked, id_images, views, options, progress, info)
            least = options.threshold
        lifted = lift(views, allowed, gaussians.sha256(), foreground, least)
    with workspace.writing("segment") as folder:
        write_lifted(folder / workspace.selections_npz.name, lifted)
        info.save(folder / workspace.segment_json.name)
        if foreground is not None:
            np.save(folder / workspace.probabilities_npy.name, foreground)
        if features is not None:
            np.save(folder / workspace.features_npy.name, features)
        for name, image in maps.items():
            write_image(folder / workspace.probability_png(name).name, np.repeat(to_uint8(image)[..., None], 3, axis=2))
    summary = {
        "views": len(lifted.views),
        "masks": len(lifted.selections),
        "candidates": len(lifted.candidates),
        "gaussians": len(gaussians),
    }
    if lifted.selections:
        return StageOutcome(summary)
    return StageOutcome(
        summary, ("no_bolls",), ("no mask holds any Gaussian; look at masks/, try another --backend or import masks",)
    )


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


def _weights(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    id_images: Sequence[NDArray[np.uint16]],
    rim_px: int,
    progress: Progress,
) -> list[ViewWeights]:
    """Blending weights over each view and inside each of its masks, which end `rim_px` before their edges."""
    views = []
    for done, (camera, ids) in enumerate(zip(cameras, id_images, strict=True)):
        progress(done, len(cameras), camera.name)
        weights = accumulate_weights(gaussians, camera, mark_rim(ids, rim_px))
        views.append(ViewWeights(camera.name, weights.total, weights.rows, weights.ids, weights.weights))
    progress(len(cameras), len(cameras))
    return views


def _probabilities(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    id_images: Sequence[NDArray[np.uint16]],
    weights: Sequence[ViewWeights],
    options: SegmentOptions,
    progress: Progress,
    info: SegmentInfo,
) -> tuple[NDArray[np.float32], dict[str, NDArray[np.float32]], SegmentInfo]:
    """Trained probabilities, their maps of a few views, and mBIoU by steps and threshold beside that of the vote.

    Every `holdout`-th view neither trains nor votes, and has an mBIoU of its own.
    """
    begin_s = time.perf_counter()
    masks = [ids > 0 for ids in id_images]
    held_out = set(range(options.holdout - 1, len(cameras), options.holdout)) if options.holdout else set()
    training = [k for k in range(len(cameras)) if k not in held_out]
    views = [sample_view(gaussians, cameras[k], masks[k], options.spacing, options.seed + k) for k in training]
    rays_seconds = time.perf_counter() - begin_s
    reached: list[tuple[int, float]] = []
    kept = []
    for step, probabilities in train_probabilities(
        views, np.full(len(gaussians), 0.5, np.float32), options.steps, options.seed
    ):
        if step % 100 == 0:
            progress(step, options.steps, "probabilities")
        if step in REPORTED_STEPS or step == options.steps:
            reached.append((step, time.perf_counter() - begin_s))
            kept.append(probabilities.copy())
    voting = [weights[k] for k in training]
    vote = vote_foreground(voting, sum_seen_weights(voting, len(gaussians)))
    columns = np.stack([*kept, vote.astype(np.float32)], axis=1)
    shown = {cameras[k].name: np.zeros(0, np.float32) for k in range(0, len(cameras), -(-len(cameras) // SHOWN_VIEWS))}

    def maps(judged: Iterable[int]) -> Iterator[NDArray[np.float32]]:
        for k in judged:
            rendered = render_values(gaussians, cameras[k], columns).image
            if cameras[k].name in shown:
                shown[cameras[k].name] = rendered[..., len(kept) - 1]
            yield rendered

    ious: list[dict[str, dict[str, float]]] = [{} for _ in range(len(kept) + 1)]
    for name, judged in (("mbiou", training), ("mbiou_held_out", sorted(held_out))):
        if judged:
            for row, found in zip(ious, mean_binary_ious(maps(judged), [masks[k] for k in judged]), strict=True):
                row[name] = dict(zip(map(str, THRESHOLDS), found.tolist(), strict=True))
    by_steps = (ReachedIous(**row, steps=n, seconds=s) for row, (n, s) in zip(ious, reached, strict=False))
    return (
        kept[-1],
        shown,
        replace(
            info,
            threshold=options.threshold,
            rays_seconds=rays_seconds,
            vote=MeanIous(**ious[-1]),
            by_steps=tuple(by_steps),
        ),
    )


def _by_features(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    id_images: Sequence[NDArray[np.uint16]],
    allowed: NDArray[np.bool_],
    options: SegmentOptions,
    progress: Progress,
    info: SegmentInfo,
) -> tuple[LiftedMasks, NDArray[np.float32], SegmentInfo]:
    """Sets of Gaussians alike, one for each mask of a few views around the plant; and the features (N, C)."""
    begin_s = time.perf_counter()
    smoothing = neighbour_means(gaussians.means)
    rays = [
        sample_rays(gaussians, camera, ids, smoothing, options.seed + k)
        for k, (camera, ids) in enumerate(zip(cameras, id_images, strict=True))
    ]
    rays_seconds = time.perf_counter() - begin_s
    features, losses = train_features(
        rays, len(gaussians), options.features, options.feature_steps, options.seed, progress
    )
    training_seconds = time.perf_counter() - begin_s
    angles = azimuths(cameras, fit_orbit(cameras)) if len(cameras) > 1 else np.zeros(len(cameras))
    chosen = evenly_spaced(angles, options.views)
    weights = _weights(gaussians, [cameras[k] for k in chosen], [id_images[k] for k in chosen], 0, progress)
    prompts = [PromptView(cameras[k], id_images[k], weight) for k, weight in zip(chosen, weights, strict=True)]
    smooth = (smoothing @ features).astype(np.float32)
    lifted, dropped = lift_prompts(gaussians, smooth, prompts, allowed, gaussians.sha256())
    return (
        lifted,
        smooth,
        replace(
            info,
            rays_seconds=rays_seconds,
            training_seconds=training_seconds,
            loss=tuple(losses[:: max(1, len(losses) // 20)]),
            seconds=time.perf_counter() - begin_s,
            sets=len(lifted.selections),
            dropped_masks=dropped,
        ),
    )


def _cost(work: Work) -> Cost:
    """Lifting the masks, and for the other methods the optimisation besides."""
    options: SegmentOptions = work.options["segment"]
    lifting_s = (0.06 * work.megapixels(options.max_side) + 0.19 * work.million_gaussians) * work.views
    steps_s = {"probability": 0.004 * options.steps, "affinity": 0.02 * options.feature_steps}
    return Cost(lifting_s + steps_s.get(options.method, 0.0))


STAGE = Stage("segment", version=4, inputs=inputs, run=run, cost=_cost, disk_bytes=twice_the_model, splats=True)
