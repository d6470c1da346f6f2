"""sfm: where the camera was for each image, by structure from motion, and the images without lens distortion."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ..capture.image_pairs import choose_pairs
from ..core.outcome import StageOutcome
from ..core.progress import Progress
from ..core.scene import Camera
from ..documents.frames import FramesInfo
from ..documents.sfm import LensDecision, SfmInfo
from ..errors import CaptureFailed
from ..files import exports
from ..files.colmap import read_cameras, read_points
from ..files.reconstruction import (
    NEEDLESS_RISE_PCT,
    ReconstructionSettings,
    reconstruct,
    straighten,
    undistort,
)
from ..files.saving import json_text
from ..geometry.camera_orbit import Orbit, find_out_of_view, fit_orbit
from ..options import SfmOptions
from ..workspace import Workspace
from .stage import Cost, Stage, Work

VIDEO_FEATURE_SIDE = 1280
"""px; finer detail of a phone's video is mostly noise and compression."""
PHOTO_SIZE, PHOTO_FEATURES = 2, 4
"""Photos are sharper than a video's frames and stand farther apart: they get these factors of size and features. (Twice
the features place 8 of 16 photos of a turn, four times all.)"""
FEATURES_PER_MP = 5700
"""Features that a megapixel has, unless there is a limit."""
FEATURE_BYTES = 200
"""A SIFT feature with its share of the matches, in the database that is kept meanwhile."""
MIN_REGISTERED_PCT = 40.0
FEW_REGISTERED_PCT = 80.0
MIN_REGISTERED = 3
MIN_COVERAGE_DEG = 90.0
"""Below it traits would be those of one side; and a camera that only turns on the spot can pass for a short arc, its
rotation explained by a wrong lens."""
MAX_GAP_DEG = 60.0
"""Beyond this gap in the orbit, sides of bolls were never seen."""


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.folder("frames")]


def run(workspace: Workspace, options: SfmOptions, progress: Progress) -> StageOutcome:
    frames = workspace.folder("frames")
    taken = FramesInfo.load(workspace.require(workspace.frames_json, "frames"))
    names = [path.name for path in workspace.frame_images()]
    if len(names) < MIN_REGISTERED:
        raise CaptureFailed(f"{len(names)} images in frames; film one slow full turn around the plant")
    settings = ReconstructionSettings(
        max_features=(1 if taken.ordered else PHOTO_FEATURES) * options.max_features,
        max_side=(1 if taken.ordered else PHOTO_SIZE) * VIDEO_FEATURE_SIDE,
        seed=options.seed,
        focal_length_px=taken.focal_length_px,
    )
    pairs = choose_pairs(len(names), options.overlap, taken.ordered)
    with workspace.writing("sfm") as folder:
        with tempfile.TemporaryDirectory(dir=folder) as work:
            models = reconstruct(frames, names, pairs, Path(work), settings, progress)
            _check_registered(models, names)
        models[0], lens = _with_lens(models[0], options)
        models[0].write_binary(folder)
        undistort(frames, folder, folder / "undistorted")
        cameras = read_cameras(folder / "undistorted" / "sparse")
        orbit = fit_orbit(cameras)
        _check_coverage(orbit)
        info = _info(models, names, cameras, orbit, lens)
        xyz, *_ = read_points(folder / "undistorted" / "sparse")
        transforms = exports.nerfstudio_transforms(cameras, "undistorted/images")
        (folder / "transforms.json").write_text(json_text(transforms), encoding="utf-8")
        np.save(folder / "poses_bounds.npy", exports.llff_poses_bounds(cameras, xyz), allow_pickle=False)
        info.save(folder / workspace.sfm_json.name)
    return _outcome(info)


def _with_lens(model: Any, options: SfmOptions) -> tuple[Any, LensDecision]:
    """The model with or without lens distortion, as the evidence or the option says, and what was found."""
    if options.distortion == "on":
        return model, LensDecision("on", on=True)
    straight, evidence = straighten(model)
    on = options.distortion == "auto" and evidence.on
    decision = LensDecision(options.distortion, on, evidence.rise_pct, NEEDLESS_RISE_PCT, evidence.corner_px)
    return model if on else straight, decision


def _check_registered(models: list[Any], names: list[str]) -> None:
    """The gate: with fewer images than this the plant would be measured from one side."""
    n = models[0].num_reg_images() if models else 0
    if n < MIN_REGISTERED or 100 * n < MIN_REGISTERED_PCT * len(names):
        raise CaptureFailed(
            f"{n} of {len(names)} frames registered ({MIN_REGISTERED_PCT:.0f} % needed); film one slow full turn with"
            f" the whole plant in view, or try --set frames.count={2 * len(names)}"
        )


def _check_coverage(orbit: Orbit) -> None:
    if not orbit.coverage_deg >= MIN_COVERAGE_DEG:
        raise CaptureFailed(
            f"the camera went {orbit.coverage_deg:.0f} degrees around what it saw ({MIN_COVERAGE_DEG:.0f} needed); film"
            " one slow full turn, walking around the plant"
        )


def _info(models: list[Any], names: list[str], cameras: list[Camera], orbit: Orbit, lens: LensDecision) -> SfmInfo:
    """How good the first of the models is, of all images `names`, and what it misses."""
    model = models[0]
    registered = [camera.name for camera in cameras]
    camera = next(iter(model.cameras.values()))
    return SfmInfo(
        n_frames=len(names),
        registered=tuple(registered),
        registered_pct=100 * len(registered) / len(names),
        unregistered=tuple(sorted(set(names) - set(registered))),
        n_models=len(models),
        n_points=model.num_points3D(),
        mean_reprojection_error_px=model.compute_mean_reprojection_error(),
        mean_track_length=model.compute_mean_track_length(),
        mean_observations=model.compute_mean_observations_per_reg_image(),
        camera_model=camera.model_name,
        camera_params=tuple(camera.params.tolist()),
        focal_length_px=camera.mean_focal_length(),
        orbit_coverage_deg=orbit.coverage_deg,
        orbit_largest_gap_deg=orbit.largest_gap_deg,
        orbit_radius_su=orbit.distance,
        orbit_axis=tuple(orbit.axis.tolist()),
        orbit_target=tuple(orbit.centre.tolist()),
        distortion=lens,
        plant_out_of_view=tuple(find_out_of_view(orbit.centre, cameras)),
    )


def _outcome(info: SfmInfo) -> StageOutcome:
    flags, warnings = [], []
    if info.registered_pct < FEW_REGISTERED_PCT:
        flags.append("few_frames_registered")
        warnings.append(
            f"{len(info.registered)} of {info.n_frames} frames registered; walk more slowly, or film with more light"
        )
    if info.orbit_largest_gap_deg > MAX_GAP_DEG:
        flags.append("orbit_gap")
        warnings.append(f"no view for {info.orbit_largest_gap_deg:.0f} degrees around the plant; film a full turn")
    lost = info.plant_out_of_view
    if lost:
        flags.append("plant_out_of_view")
        warnings.append(f"the plant has left the frame in {len(lost)} images, e.g. {lost[0]}; keep it in the middle")
    keys = ("registered_pct", "n_points", "mean_reprojection_error_px", "orbit_coverage_deg")
    return StageOutcome({key: round(getattr(info, key), 3) for key in keys}, tuple(flags), tuple(warnings))


def _disk_bytes(workspace: Workspace, options: SfmOptions) -> float:
    images = [path.stat().st_size for path in workspace.frame_images()]
    return 2 * sum(images) + len(images) * options.max_features * FEATURE_BYTES


def _cost(work: Work) -> Cost:
    """Features of each image, matches of each pair, and cameras placed one after the other."""
    options, images, ordered = work.options["sfm"], work.images, work.source.is_video
    mp = work.megapixels(VIDEO_FEATURE_SIDE * (1 if ordered else PHOTO_SIZE))
    wanted = options.max_features * (1 if ordered else PHOTO_FEATURES)
    fullness = min(wanted, FEATURES_PER_MP * mp) / 2048
    pairs = images * options.overlap if ordered else images * (images - 1) / 2
    return Cost((0.05 + 0.55 * mp) * images + 0.05 * fullness**2 * pairs, 0.005 * fullness**2 * images**2)


STAGE = Stage(
    "sfm",
    version=6,
    inputs=inputs,
    run=run,
    cost=_cost,
    disk_bytes=_disk_bytes,
    droppable=lambda workspace: sorted((workspace.undistorted / "images").glob("*.jpg")),
)
