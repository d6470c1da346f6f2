# SPDX-License-Identifier: Apache-2.0
"""Turns masks into sets of Gaussians by any of the methods, with figures and pictures of the result."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import LiftedMasks
from ..core.runs import Progress, silent
from ..core.scene import Camera, Gaussians
from ..gaussians.rasterizer import accumulate_weights, render_values
from ..geometry.camera_orbit import azimuths, evenly_spaced, fit_orbit, within_orbit
from ..options import AffinityOptions, ProbabilityOptions, SegmentOptions
from ..schemas.segment import MeanIous, ReachedIous, SegmentInfo
from .affinity import neighbour_means, sample_rays, train_features
from .lift import (
    FOREGROUND_SHARE,
    ViewWeights,
    lift,
    mark_rim,
    rim_width_px,
    sum_seen_weights,
    vote_foreground,
)
from .probability import REPORTED_STEPS, THRESHOLDS, mean_binary_ious, sample_view, train_probabilities
from .probability_pictures import PICTURED_STEPS, draw_lint, draw_training
from .prompts import PromptView, lift_prompts

SHOWN_VIEWS: Final = 4
"""Number of maps of probabilities that are kept."""


@dataclass(frozen=True)
class Segmented:
    """The Gaussians that the masks hold, with the evidence for it."""

    lifted: LiftedMasks
    info: SegmentInfo
    probabilities: NDArray[np.float32] | None = None
    """Method probability: (N,) probability that each Gaussian is lint."""
    features: NDArray[np.float32] | None = None
    """Method affinity: (N, C), alike within a boll."""
    maps: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    """Method probability: image -> (H, W) rendered probabilities, of a few views."""
    over_training: dict[str, NDArray[np.uint8]] = field(default_factory=dict)
    """Method probability: image -> picture of its map over the steps, of the same views."""
    lint_alone: dict[str, NDArray[np.uint8]] = field(default_factory=dict)
    """Method probability: image -> picture of the lint alone."""


def segmented(
    gaussians: Gaussians,
    all_cameras: Sequence[Camera],
    cameras: Sequence[Camera],
    id_images: Sequence[NDArray[np.uint16]],
    options: SegmentOptions,
    progress: Progress = silent,
) -> Segmented:
    """Lift masks onto Gaussians by the method of `options`.

    Args:
        all_cameras: Gaussians beyond them are not bolls.
        cameras: those whose images have masks, in the size of these.
        id_images: (H, W) ids of the masks of each of `cameras`, 0 = background.
    """
    allowed = within_orbit(gaussians.means, all_cameras, fit_orbit(all_cameras))
    method = "lift" if options.method == "lint" else options.method
    info = SegmentInfo(method, options.target)
    if options.method == "affinity":
        return _by_features(gaussians, cameras, id_images, allowed, options.affinity, progress, info)
    begin_s = time.perf_counter()
    rim_px = rim_width_px(id_images)
    views = _weights(gaussians, cameras, id_images, rim_px, progress)
    info = replace(info, rim_px=rim_px, weights_seconds=time.perf_counter() - begin_s)
    if options.method in {"lint", "lift"} or not cameras:
        return Segmented(lift(views, allowed, gaussians.sha256(), None, FOREGROUND_SHARE), info)
    return _by_probabilities(gaussians, cameras, id_images, allowed, views, options.probability, progress, info)


def _weights(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    id_images: Sequence[NDArray[np.uint16]],
    rim_px: int,
    progress: Progress,
) -> list[ViewWeights]:
    """Blending weights over each view, and inside each of its masks without a rim of `rim_px`."""
    views = []
    for done, (camera, ids) in enumerate(zip(cameras, id_images, strict=True)):
        progress(done, len(cameras), camera.name)
        weights = accumulate_weights(gaussians, camera, mark_rim(ids, rim_px))
        views.append(ViewWeights(camera.name, weights.total, weights.rows, weights.ids, weights.weights))
    progress(len(cameras), len(cameras))
    return views


def _by_probabilities(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    id_images: Sequence[NDArray[np.uint16]],
    allowed: NDArray[np.bool_],
    weights: Sequence[ViewWeights],
    options: ProbabilityOptions,
    progress: Progress,
    info: SegmentInfo,
) -> Segmented:
    """Train probabilities; with maps of a few views, and mBIoU by steps and threshold beside that of the vote.

    Every `holdout`-th view neither trains nor votes; these views have an mBIoU of their own.
    """
    begin_s = time.perf_counter()
    masks = [ids > 0 for ids in id_images]
    held_out = set(range(options.holdout - 1, len(cameras), options.holdout)) if options.holdout else set()
    training = [k for k in range(len(cameras)) if k not in held_out]
    views = [sample_view(gaussians, cameras[k], masks[k], options.spacing, options.seed + k) for k in training]
    rays_seconds = time.perf_counter() - begin_s
    reached: list[tuple[int, float]] = []
    kept = []
    start = np.full(len(gaussians), 0.5, np.float32)
    pictured = {0: start}
    for step, probabilities in train_probabilities(views, start, options.steps, options.seed):
        if step % 100 == 0:
            progress(step, options.steps, "probabilities")
        if step in REPORTED_STEPS or step == options.steps:
            reached.append((step, time.perf_counter() - begin_s))
            kept.append(probabilities.copy())
        if step in PICTURED_STEPS or step == options.steps:
            pictured[step] = probabilities.copy()
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
    info = replace(
        info,
        threshold=options.threshold,
        rays_seconds=rays_seconds,
        vote=MeanIous(**ious[-1]),
        by_steps=tuple(by_steps),
    )
    lint = gaussians[kept[-1] > options.threshold]
    pictures = [camera for camera in cameras if camera.name in shown]
    return Segmented(
        lift(weights, allowed, gaussians.sha256(), kept[-1], options.threshold),
        info,
        kept[-1],
        maps=shown,
        over_training={camera.name: draw_training(gaussians, camera, pictured) for camera in pictures},
        lint_alone={camera.name: draw_lint(lint, camera) for camera in pictures},
    )


def _by_features(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    id_images: Sequence[NDArray[np.uint16]],
    allowed: NDArray[np.bool_],
    options: AffinityOptions,
    progress: Progress,
    info: SegmentInfo,
) -> Segmented:
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
    info = replace(
        info,
        rays_seconds=rays_seconds,
        training_seconds=training_seconds,
        loss=tuple(losses[:: max(1, len(losses) // 20)]),
        seconds=time.perf_counter() - begin_s,
        sets=len(lifted.selections),
        dropped_masks=dropped,
    )
    return Segmented(lifted, info, features=smooth)
