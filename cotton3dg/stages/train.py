"""Train a Gaussian model on the undistorted images."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from .. import __version__, _native
from ..core.outcome import StageOutcome
from ..core.progress import Progress, silent
from ..core.scene import Float64, Gaussians
from ..documents.frames import FramesInfo
from ..documents.sfm import SfmInfo
from ..documents.train import (
    Effects,
    ExposureDecision,
    HeldOut,
    MotionBlurFound,
    RejectedStep,
    RollingShutterFound,
    TrainedSteps,
    TrainMetrics,
)
from ..errors import BadInput
from ..files.checkpoint import read_training, write_training
from ..files.colmap import read_cameras, read_points, read_positions, read_tracks
from ..files.images import read_image, write_image
from ..files.ply import write_gaussians
from ..files.saving import explain_disk_errors, json_text, replacing
from ..geometry.camera_orbit import fit_orbit
from ..options import TrainOptions, as_dict
from ..splat import motion_blur as blurring
from ..splat import rolling_shutter as rolling
from ..splat.densify import scheduled_count
from ..splat.exposure import VISIBLE, correct, estimate_exposure
from ..splat.initialise import FILL_SHARE, START_SHARE, start_gaussians
from ..splat.metrics import PLANT_REGION, ViewQuality, view_quality
from ..splat.motion import find_longest_tracks
from ..splat.trainer import DENSIFY_FROM, DENSIFY_UNTIL, Fit, Training, fit, levels
from ..splat.views import View
from ..workspace import Workspace
from .stage import Cost, Stage, Work

T = TypeVar("T")

LOW_PSNR_DB = 22.0
"""Below this the render is visibly blurred, and traits measured on it are doubtful."""

COMPARISONS = 4
"""Held-out views saved beside their renders."""
COST_SLICES = 20
"""Parts of a training over which its cost takes the number of Gaussians as constant."""
MOTION_POINTS = 600
"""The points seen in the most images suffice for what the camera's motion did to the images."""


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted]


def run(workspace: Workspace, options: TrainOptions, progress: Progress = silent) -> StageOutcome:
    """Writes gaussians.ply, metrics.json and a few photos beside their renders."""
    capture = load_capture(workspace, options)
    outcome = _save(workspace, _fitted(workspace, options, capture.training, progress), capture)
    workspace.train_checkpoint.unlink(missing_ok=True)
    return outcome


def save_intermediate(
    workspace: Workspace, options: TrainOptions, targets: Mapping[int, Workspace], progress: Progress = silent
) -> dict[int, StageOutcome]:
    """Train once and save the model after so many steps as the result of this stage in other folders.

    The schedules of a training are made for its last step: a training that ends at an earlier one does better than this
    training there.

    Args:
        targets: number of steps -> whose train folder gets the model. The clock stands while models are saved.
    """
    began, cpu_began = time.perf_counter(), time.process_time()
    capture = load_capture(workspace, options)
    outcomes: dict[int, StageOutcome] = {}

    def watch(step: int, gaussians: Gaussians) -> None:
        nonlocal began, cpu_began
        if step not in targets or step == options.steps:
            return
        now, cpu_now = time.perf_counter(), time.process_time()
        reached = {
            "step": step,
            "seconds": round(now - began, 3),
            "cpu_seconds": round(cpu_now - cpu_began, 3),
            "n_gaussians": len(gaussians),
        }
        outcomes[step] = _save(targets[step], Fit(gaussians, [reached]), capture)
        began, cpu_began = began + time.perf_counter() - now, cpu_began + time.process_time() - cpu_now

    result = fit(_start(workspace, options, capture.training), capture.training, options, progress, watch)
    if options.steps in targets:
        result.history[-1] |= {
            "seconds": round(time.perf_counter() - began, 3),
            "cpu_seconds": round(time.process_time() - cpu_began, 3),
        }
        outcomes[options.steps] = _save(targets[options.steps], result, capture)
    return outcomes


def _save(workspace: Workspace, result: Fit, capture: Capture) -> StageOutcome:
    """Judge the model by the held-out views and write the stage's folder."""
    views, held_out = capture.views, capture.held_out
    orbit = fit_orbit([view.camera for view in views])
    qualities = [
        view_quality(result.gaussians, view, orbit, gains)
        for view, gains in zip(held_out, capture.held_out_gains, strict=True)
    ]
    pixel_su = orbit.distance / float(np.median([view.camera.fx for view in views]))
    metrics = _metrics(result, qualities, pixel_su)
    with workspace.writing("train") as folder:
        write_gaussians(folder / workspace.gaussians_ply.name, result.gaussians)
        metrics.save(folder / workspace.metrics_json.name)
        capture.effects.save(folder / workspace.effects_json.name)
        for i in np.unique(np.linspace(0, len(qualities) - 1, min(COMPARISONS, len(qualities))).round().astype(int)):
            pair = np.concatenate([held_out[i].image, qualities[i].rendered], axis=1)
            write_image(folder / f"held_out_{Path(qualities[i].name).stem}.jpg", pair)
    return _outcome(metrics, capture.effects)


def _fitted(workspace: Workspace, options: TrainOptions, views: list[View], progress: Progress) -> Fit:
    """Train, going on where an interrupted training of the same images with the same options was last saved."""
    key = _training_key(workspace, options)

    def save(training: Training) -> None:
        with explain_disk_errors(workspace.root), replacing(workspace.train_checkpoint) as path:
            write_training(path, training, key)

    def keep_rejected(training: Training, view: View) -> None:
        with explain_disk_errors(workspace.root), replacing(workspace.train_rejected) as path:
            write_training(path, training, key, view)

    start: Gaussians | Training | None = read_training(workspace.train_checkpoint, key)
    if start is None:
        workspace.train_rejected.unlink(missing_ok=True)
        start = _start(workspace, options, views)
    return fit(start, views, options, progress, save=save, keep_rejected=keep_rejected)


def _start(workspace: Workspace, options: TrainOptions, views: list[View]) -> Gaussians:
    points, colours, _, _ = read_points(workspace.undistorted / "sparse")
    return start_gaussians(points, colours, views, options)


def _training_key(workspace: Workspace, options: TrainOptions) -> str:
    """Hash of all that decides what a training makes."""
    facts = [
        __version__,
        STAGE.version,
        _native.instruction_set(),
        as_dict(options),
        workspace.hashes(*inputs(workspace)),
    ]
    return hashlib.sha256(json_text(facts).encode()).hexdigest()


@dataclass(frozen=True)
class Capture:
    """The photos as trained on and as judged by."""

    views: list[View]
    """As filmed, in order of name."""
    training: list[View]
    """Corrected for the effects that are there."""
    held_out: list[View]
    """As filmed."""
    held_out_gains: list[Float64]
    """(3,) for each, to be put on its render."""
    effects: Effects


def load_capture(workspace: Workspace, options: TrainOptions) -> Capture:
    """Load the views, look for effects of the camera and correct those that are there (or that the options force)."""
    views = load_views(workspace, options.max_side)
    gains = np.ones((len(views), 3))
    decision = ExposureDecision(options.exposure, on=options.exposure == "on")
    if options.exposure != "off":
        tracks = read_tracks(workspace.undistorted / "sparse")
        full = {camera.name: camera.width for camera in read_cameras(workspace.undistorted / "sparse")}
        places = [tracks[view.camera.name][0] * (view.camera.width / full[view.camera.name]) for view in views]
        found = estimate_exposure(views, places, [tracks[view.camera.name][1] for view in views])
        on = options.exposure == "on" or found.varies
        gains = found.gains if on else gains
        decision = ExposureDecision(
            options.exposure,
            on,
            spread_pct=100 * found.spread,
            error_pct=100 * found.error,
            visible_from_pct=100 * VISIBLE,
            n_observations=found.n_observations,
            gains={view.camera.name: tuple(gain) for view, gain in zip(views, found.gains.tolist(), strict=True)},
        )
    sfm = SfmInfo.load_if_there(workspace.sfm_json)  # not there where the cameras come from elsewhere
    effects = Effects(decision, sfm.distortion if sfm else None, *_motion(workspace, views))
    usable = [correct(view, gain) if (gain != 1).any() else view for view, gain in zip(views, gains, strict=True)]
    training, _ = hold_out(usable, options.holdout)
    _, held_out = hold_out(views, options.holdout)
    _, held_out_gains = hold_out(list(gains), options.holdout)
    return Capture(views, training, held_out, held_out_gains, effects)


def _motion(workspace: Workspace, views: list[View]) -> tuple[MotionBlurFound | None, RollingShutterFound | None]:
    """What the camera's motion did to the images of a video: reported, never modelled (docs/training.md says why)."""
    times = _times(workspace, [view.camera.name for view in views])
    if times is None:
        return None, None
    sparse = workspace.undistorted / "sparse"
    tracks = find_longest_tracks(
        read_cameras(sparse), times, read_tracks(sparse), read_positions(sparse), MOTION_POINTS
    )
    blur, shutter = blurring.estimate_motion_blur(views, tracks), rolling.estimate_rolling_shutter(tracks)
    return MotionBlurFound(
        on=False,
        found=blur.found,
        median_px=blur.median_px,
        error_px=blur.error_px,
        strong_px=blur.strong_px,
        visible_from_px=blurring.VISIBLE_PX,
        flow_px=blur.flow_px,
        lengths_px={view.camera.name: length for view, length in zip(views, blur.lengths_px.tolist(), strict=True)},
    ), RollingShutterFound(
        on=False,
        found=shutter.found,
        read_out_frames=shutter.read_out,
        error_frames=shutter.error,
        shift_px=shutter.shift_px,
        left_px=shutter.left_px,
        visible_from_px=rolling.VISIBLE_PX,
    )


def _times(workspace: Workspace, names: list[str]) -> Float64 | None:
    """When the images were taken, in frames of the video; None of photos and of cameras that come from elsewhere."""
    taken = FramesInfo.load_if_there(workspace.frames_json)
    if taken is None or taken.video is None:
        return None
    taken_s = {image.name: image.timestamp_s for image in taken.images}
    times = taken.video.fps * np.array([taken_s.get(name) for name in names], float)
    return times if len(times) > 2 and (np.diff(times) > 0).all() else None


def load_views(workspace: Workspace, max_side: int) -> list[View]:
    """The undistorted images with their cameras in order of name, at most `max_side` px long.

    Raises:
        MissingInput: the sfm stage has not run.
        BadInput: an image cannot be decoded or has another size than its camera.
    """
    workspace.require(workspace.undistorted / "sparse", "sfm")
    views = []
    for camera in read_cameras(workspace.undistorted / "sparse"):
        image = read_image(workspace.require(workspace.undistorted_image(camera.name), "sfm"))
        if image.shape[:2] != (camera.height, camera.width):
            raise BadInput(f"{camera.name} has another size than its camera; run `cotton3dg sfm` again")
        views.append(View(camera, image).limited(max_side))
    return views


def hold_out(views: list[T], every: int) -> tuple[list[T], list[T]]:
    """Training and held-out views: every `every`-th from the first is held out, none for 0 or if none would be left.

    Also for a list of something that belongs to the views, one each.
    """
    held_out = views[::every] if every > 1 else []
    return [view for i, view in enumerate(views) if every <= 1 or i % every], held_out


def _metrics(result: Fit, qualities: list[ViewQuality], pixel_su: float) -> TrainMetrics:
    def mean(values: list[float]) -> float:
        finite = [value for value in values if math.isfinite(value)]
        return float(np.mean(finite)) if finite else math.nan

    last = result.history[-1]
    return TrainMetrics(
        psnr_db=mean([quality.psnr_db for quality in qualities]),
        ssim=mean([quality.ssim for quality in qualities]),
        plant_psnr_db=mean([quality.plant_psnr_db for quality in qualities]),
        plant_ssim=mean([quality.plant_ssim for quality in qualities]),
        plant_region=f"rendered surfaces within {PLANT_REGION} of the cameras' distance from their centre",
        n_gaussians=len(result.gaussians),
        steps=last["step"],
        seconds=last["seconds"],
        cpu_seconds=last["cpu_seconds"],
        n_pruned=result.n_pruned,
        n_split=result.n_split,
        culled=result.culled,
        rejected_steps=tuple(RejectedStep(step, name) for step, name in result.rejected),
        held_out=tuple(
            HeldOut(each.name, each.psnr_db, each.ssim, each.plant_psnr_db, each.plant_ssim, each.plant_share)
            for each in qualities
        ),
        history=tuple(TrainedSteps(**reached) for reached in result.history),
        pixel_su=pixel_su,
    )


def _outcome(metrics: TrainMetrics, effects: Effects) -> StageOutcome:
    summary = {
        "psnr_db": round(metrics.psnr_db, 2),
        "plant_psnr_db": round(metrics.plant_psnr_db, 2),
        "n_gaussians": metrics.n_gaussians,
        "steps": metrics.steps,
        "seconds": round(metrics.seconds, 2),
        "cpu_seconds": round(metrics.cpu_seconds, 2),
        "effects": ", ".join(effects.on) or "none",
    }
    flags, warnings = [], []
    unusable = {reason: n for reason, n in metrics.culled.items() if n}
    if unusable:
        flags.append("gaussians_culled")
        told = ", ".join(f"{n} {reason.replace('_', ' ')}" for reason, n in unusable.items())
        warnings.append(f"Gaussians that cannot be drawn were left out ({told}, summed over steps)")
    if metrics.psnr_db < LOW_PSNR_DB:
        flags.append("low_psnr")
        warnings.append(f"renders differ from the photos (PSNR {metrics.psnr_db:.1f} dB); try --preset paper")
    if metrics.rejected_steps:
        flags.append("training_steps_rejected")
        warnings.append(
            f"{len(metrics.rejected_steps)} training steps had a loss that was not finite and were undone; metrics.json"
            " names their images, records/train.rejected.npz holds the first"
        )
    return StageOutcome(summary, tuple(flags), tuple(warnings))


def _disk_bytes(_: Workspace, options: TrainOptions) -> float:
    # float32: 14 parameters, 3 normals and the colours; the checkpoint holds them with two moments and more.
    values = 17 + 3 * (options.sh_degree + 1) ** 2
    return 5 * 4 * values * options.max_gaussians


def _cost(work: Work) -> Cost:
    """Loading the images, and all steps: each costs by its pixels and by the Gaussians there are by then."""
    options: TrainOptions = work.options["train"]
    full_mp = work.megapixels(options.max_side)
    ends = levels(min(options.max_side, max(work.size)), options.steps)
    start = (START_SHARE + FILL_SHARE) * options.max_gaussians
    # A fifth of a Gaussian's time, at degree 3, goes into its colour and the optimiser of it.
    per_million = 0.4 + 0.006 * (options.sh_degree + 1) ** 2
    steps_s = 0.0
    for i in range(COST_SLICES):
        share = (i + 0.5) / COST_SLICES
        factor = next(factor for until, factor in ends if share * options.steps < until or factor == 1)
        grown = (share - DENSIFY_FROM) / (DENSIFY_UNTIL - DENSIFY_FROM)
        millions = scheduled_count(round(start), options.max_gaussians, grown) / 1e6
        steps_s += options.steps / COST_SLICES * (0.15 * full_mp / factor**2 + per_million * millions)
    return Cost((0.05 + 0.22 * full_mp) * work.images + steps_s)


STAGE = Stage("train", version=9, inputs=inputs, run=run, cost=_cost, disk_bytes=_disk_bytes, splats=True)
