# SPDX-License-Identifier: Apache-2.0
"""Train a Gaussian model on the undistorted images."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Final

from .. import __version__, _native
from ..core.machine import on_all_cores
from ..core.runs import Progress, StageOutcome, Stopwatch, silent
from ..core.scene import Camera, Gaussians
from ..errors import BadInput
from ..gaussians.plant_windows import find_plant_windows
from ..gaussians.rasterizer import Window
from ..gaussians.views import View
from ..io.colmap import read_cameras, read_points, read_positions, read_tracks
from ..io.images import read_image, write_image
from ..io.ply import write_gaussians
from ..io.saving import explain_disk_errors, json_text, replacing
from ..option_rules import as_dict
from ..options import TrainOptions
from ..schemas.frames import FramesInfo
from ..schemas.sfm import SfmInfo
from ..schemas.train import TrainMetrics
from ..stage import FILE, Cost, Stage, Work
from ..workspace import Workspace
from .checkpoint import read_training, write_training
from .densify import scheduled_count
from .foreign_model import as_fit, explained, read_foreign
from .initialise import FILL_SHARE, START_SHARE, start_gaussians
from .photos import Capture, SparseModel, capture_of
from .quality import evaluate_held_out, outcome_of
from .schedule import DENSIFY_AFTER, DENSIFY_UNTIL, levels
from .trainer import Fit, Training, fit

COST_SLICES: Final = 20
"""Parts of a training over which its cost takes the number of Gaussians as constant."""

WINDOWED: Final = 0.6
"""Mean cost of a step, relative to a step on the whole image, once most steps use the plant alone. The plant's window
is a third of the image."""


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted]


def run(workspace: Workspace, options: TrainOptions, progress: Progress = silent) -> StageOutcome:
    """Writes gaussians.ply, metrics.json and a few photos beside their renders."""
    watch = Stopwatch()
    capture = load_capture(workspace, options)
    watch.lap("loading")
    if options.model:
        model = read_foreign(*STAGE.named_files(workspace, options))
        outcome = save_model(workspace, as_fit(model), capture)
        watch.lap("judging")
        return replace(explained(outcome, TrainMetrics.load(workspace.metrics_json)), parts_s=watch.parts_s)
    result = _fitted(workspace, options, capture.training, progress, watch)
    watch.lap("steps")
    outcome = save_model(workspace, result, capture)
    watch.lap("judging")
    workspace.train_checkpoint.unlink(missing_ok=True)
    return replace(outcome, parts_s=watch.parts_s)


def load_capture(workspace: Workspace, options: TrainOptions) -> Capture:
    """The photos with their cameras, corrected for the effects that are there."""
    views, sparse = load_views(workspace, options.max_side), workspace.undistorted / "sparse"
    model = SparseModel(read_cameras(sparse), read_tracks(sparse), read_positions(sparse))
    # Neither file exists where the cameras come from elsewhere.
    frames, sfm = FramesInfo.load_if_there(workspace.frames_json), SfmInfo.load_if_there(workspace.sfm_json)
    return capture_of(views, model, frames, sfm, options)


def load_views(workspace: Workspace, max_side: int) -> list[View]:
    """The undistorted images with their cameras in order of name, at most `max_side` px long.

    Raises:
        MissingInput: the sfm stage has not run.
        BadInput: an image cannot be decoded or has another size than its camera.
    """
    workspace.require(workspace.undistorted / "sparse", "sfm")

    def load(camera: Camera) -> View:
        image = read_image(workspace.require(workspace.undistorted_image(camera.name), "sfm"))
        if image.shape[:2] != (camera.height, camera.width):
            raise BadInput(f"{camera.name} has another size than its camera; run `cotton3dg sfm` again")
        return View(camera, image).limited(max_side)

    return on_all_cores(load, read_cameras(workspace.undistorted / "sparse"))


def load_start(workspace: Workspace, options: TrainOptions, views: list[View]) -> Gaussians:
    """The Gaussians from which the training starts."""
    points, colours, _, _ = read_points(workspace.undistorted / "sparse")
    return start_gaussians(points, colours, views, options)


def load_windows(workspace: Workspace, options: TrainOptions, views: list[View]) -> list[Window | None]:
    """The part of each view that shows the plant; None = all of it."""
    if not options.plant_window:
        return [None] * len(views)
    points, _, _, _ = read_points(workspace.undistorted / "sparse")
    return find_plant_windows(points, [view.camera for view in views])


def save_model(workspace: Workspace, result: Fit, capture: Capture) -> StageOutcome:
    """Judge the model by the held-out views and write the stage's folder."""
    found = evaluate_held_out(result, capture)
    with workspace.writing("train") as folder:
        write_gaussians(folder / workspace.gaussians_ply.name, result.gaussians)
        found.metrics.save(folder / workspace.metrics_json.name)
        capture.effects.save(folder / workspace.effects_json.name)
        for name, pair in found.comparisons.items():
            write_image(folder / f"held_out_{Path(name).stem}.jpg", pair)
    return outcome_of(found.metrics, capture.effects)


def _fitted(
    workspace: Workspace, options: TrainOptions, views: list[View], progress: Progress, watch: Stopwatch
) -> Fit:
    """Train, or resume an interrupted training of the same images with the same options where it was last saved."""
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
        start = load_start(workspace, options, views)
    windows = load_windows(workspace, options, views)
    watch.lap("starting points")
    return fit(start, views, options, progress, windows=windows, save=save, keep_rejected=keep_rejected)


def _training_key(workspace: Workspace, options: TrainOptions) -> str:
    """Hash of everything that determines the result of a training."""
    facts = [
        __version__,
        STAGE.version,
        _native.instruction_set(),
        as_dict(options),
        workspace.hashes(*inputs(workspace)),
    ]
    return hashlib.sha256(json_text(facts).encode()).hexdigest()


def _disk_bytes(_: Workspace, options: TrainOptions) -> float:
    # float32: 14 parameters, 3 normals and the colours; the checkpoint holds them with two moments and more.
    values = 17 + 3 * (options.sh_degree + 1) ** 2
    return 5 * 4 * values * options.max_gaussians


def _cost(work: Work) -> Cost:
    """Loading the images, and all steps: each costs by its pixels and by the Gaussians there are by then."""
    options: TrainOptions = work.options["train"]
    full_mp = work.megapixels(options.max_side)
    judging = Cost((0.03 + 0.17 * full_mp) * work.images)
    if options.model:
        return judging
    ends = levels(min(options.max_side, max(work.size)), options.steps)
    start = (START_SHARE + FILL_SHARE) * options.max_gaussians
    # A quarter of a Gaussian's time, at degree 3, goes into its colour and the optimiser of it.
    per_million = 0.2 + 0.0044 * (options.sh_degree + 1) ** 2
    steps_s = 0.0
    for i in range(COST_SLICES):
        share = (i + 0.5) / COST_SLICES
        factor = next(factor for until, factor in ends if share * options.steps < until or factor == 1)
        grown = (share - DENSIFY_AFTER) / (DENSIFY_UNTIL - DENSIFY_AFTER)
        millions = scheduled_count(round(start), options.max_gaussians, grown) / 1e6
        of_whole = WINDOWED if options.plant_window and factor == 1 and share > DENSIFY_UNTIL else 1.0
        steps_s += options.steps / COST_SLICES * of_whole * (0.1 * full_mp / factor**2 + per_million * millions)
    return Cost(judging.shared_s + steps_s)


STAGE: Final = Stage(
    "train",
    version=13,
    inputs=inputs,
    run=run,
    cost=_cost,
    disk_bytes=_disk_bytes,
    names={"model": FILE, "transforms": FILE},
    splats=True,
)
