# SPDX-License-Identifier: Apache-2.0
"""sfm: where the camera was for each image, by structure from motion, and the images without lens distortion."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from ..core.runs import Progress, StageOutcome, Stopwatch
from ..errors import BadInput
from ..io import exports
from ..io.colmap import read_cameras, read_points
from ..io.saving import json_text
from ..options import SfmOptions
from ..schemas.frames import FramesInfo
from ..schemas.record import Record
from ..stage import Cost, Stage, Work
from ..workspace import Workspace
from .image_pairs import choose_pairs
from .keyframes import Keyframes, keyframe_spacing
from .lens import undistort
from .reconstruction import ReconstructionSettings, has_keyframes, place_keyframes, reconstruct
from .registration_quality import (
    decide_distortion,
    describe_cameras,
    outcome_of,
    require_agreement,
    require_images,
    require_registered,
)

RECORD: Final = "record.json"
"""File with the record of what `begin` did."""
VIDEO_FEATURE_SIDE: Final = 1280
"""Size at which features of a video are looked for, px. Finer detail of a phone's video is mostly noise and
compression."""
PHOTO_SIZE: Final = 2
PHOTO_FEATURES: Final = 4
PHOTO_PARTNERS: Final = 2
"""Factors of size, features and images to match with for photos, which are sharper than a video's frames and stand
farther apart."""
FEW_PHOTOS: Final = 32
FEATURES_OF_FEW: Final = 8
"""Few photos stand farther apart still, and get more features. (With four times as many features as a frame, 14 of 16
photos of a turn are placed; with eight times as many, all.)"""
FEATURES_PER_MP: Final = 5700
"""Features that a megapixel has, unless there is a limit."""
FEATURE_BYTES: Final = 200
"""A SIFT feature with its share of the matches, in the database that is kept meanwhile."""


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.folder("frames")]


def run(workspace: Workspace, options: SfmOptions, progress: Progress) -> StageOutcome:
    frames = workspace.folder("frames")
    names, pairs, settings = _task(workspace, options)
    keyframes = _begun(workspace, options)
    watch = Stopwatch()
    with workspace.writing("sfm") as folder:
        with tempfile.TemporaryDirectory(dir=folder) as work:
            found = reconstruct(frames, names, pairs, Path(work), settings, progress, watch, keyframes)
            models = found.models
            require_registered(models, names)
            require_agreement(found.contradicted_pct)
        models[0], lens = decide_distortion(models[0], options.distortion)
        watch.lap("deciding the lens")
        models[0].write_binary(folder)
        undistort(frames, folder, folder / "undistorted")
        cameras = read_cameras(folder / "undistorted" / "sparse")
        info = replace(
            describe_cameras(models, names, cameras, lens),
            rescue=found.rescue,
            contradicted_pct=found.contradicted_pct,
        )
        xyz, *_ = read_points(folder / "undistorted" / "sparse")
        transforms = exports.nerfstudio_transforms(cameras, "undistorted/images")
        (folder / "transforms.json").write_text(json_text(transforms), encoding="utf-8")
        np.save(folder / "poses_bounds.npy", exports.llff_poses_bounds(cameras, xyz), allow_pickle=False)
        info.save(folder / workspace.sfm_json.name)
    shutil.rmtree(workspace.sfm_begun, ignore_errors=True)
    watch.lap("undistorting")
    return replace(outcome_of(info), parts_s=watch.parts_s)


def begin(workspace: Workspace, options: SfmOptions, progress: Progress) -> None:
    """Place the keyframes of a film into `records/sfm.begun`, unless that is done; `run` goes on from them.

    A capture without keyframes, i.e. photos or hardly more frames than keyframes, is left as it is.
    """
    names, pairs, settings = _task(workspace, options)
    if not has_keyframes(len(names), settings) or _begun(workspace, options):
        return
    with workspace.writing(workspace.sfm_begun.relative_to(workspace.root).as_posix()) as folder:
        place_keyframes(workspace.folder("frames"), names, pairs, folder, settings, progress).save()
        _begun_from(workspace, options).save(folder / RECORD)


def _begun(workspace: Workspace, options: SfmOptions) -> Keyframes | None:
    """The keyframes that `begin` placed for the very same task."""
    try:
        if Record.load(workspace.sfm_begun / RECORD) == _begun_from(workspace, options):
            return Keyframes.load(workspace.sfm_begun)
    except BadInput:
        pass
    return None


def _begun_from(workspace: Workspace, options: SfmOptions) -> Record:
    return replace(STAGE.record(options, "begun"), inputs=workspace.hashes(*inputs(workspace)))


def _task(workspace: Workspace, options: SfmOptions) -> tuple[list[str], list[tuple[int, int]], ReconstructionSettings]:
    """Names of the images, pairs to match, and the limits."""
    taken = FramesInfo.load(workspace.require(workspace.frames_json, "frames"))
    names = [path.name for path in workspace.frame_images()]
    require_images(names)
    settings = ReconstructionSettings(
        max_features=_max_features(options, len(names), taken.ordered),
        max_side=(1 if taken.ordered else PHOTO_SIZE) * VIDEO_FEATURE_SIDE,
        seed=options.seed,
        focal_length_px=taken.focal_length_px,
        overlap=options.overlap,
        partners=None if taken.ordered else PHOTO_PARTNERS * options.overlap,
    )
    return names, choose_pairs(len(names), options.overlap, taken.ordered), settings


def _max_features(options: SfmOptions, images: int, ordered: bool) -> int:
    factor = 1 if ordered else FEATURES_OF_FEW if images <= FEW_PHOTOS else PHOTO_FEATURES
    return factor * options.max_features


def _disk_bytes(workspace: Workspace, options: SfmOptions) -> float:
    images = [path.stat().st_size for path in workspace.frame_images()]
    return 2 * sum(images) + len(images) * options.max_features * FEATURE_BYTES


def _cost(work: Work) -> Cost:
    """Features of each image, matches of each pair, and cameras placed one after the other, or by keyframes."""
    options, images, ordered = work.options["sfm"], work.images, work.source.is_video
    mp = work.megapixels(VIDEO_FEATURE_SIDE * (1 if ordered else PHOTO_SIZE))
    fullness = min(_max_features(options, images, ordered), FEATURES_PER_MP * mp) / 2048
    all_pairs = images * (images - 1) / 2
    pairs = images * options.overlap if ordered else min(all_pairs, PHOTO_PARTNERS * images * options.overlap)
    looked_at = 0 if ordered else all_pairs
    one_by_one = images / keyframe_spacing(images) if ordered else images
    return Cost(
        (0.02 + 0.12 * mp) * images + 0.0115 * fullness**2 * pairs + 0.0007 * looked_at,
        fullness * (0.0028 * one_by_one**2 + 0.2 * (images - one_by_one)) + 0.02 * images,
    )


STAGE: Final = Stage(
    "sfm",
    version=14,
    inputs=inputs,
    run=run,
    begin=begin,
    cost=_cost,
    disk_bytes=_disk_bytes,
    droppable=lambda workspace: sorted((workspace.undistorted / "images").glob("*.jpg")),
)
