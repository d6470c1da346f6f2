# SPDX-License-Identifier: Apache-2.0
"""The photos of a capture that the training uses, corrected for the effects of the camera that they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float64
from ..gaussians.views import View, hold_out
from ..options import TrainOptions
from ..schemas.frames import FramesInfo
from ..schemas.sfm import SfmInfo
from ..schemas.train import Effects, ExposureDecision, MotionBlurFound, RollingShutterFound
from .effects import motion_blur as blurring
from .effects import rolling_shutter as rolling
from .effects.exposure import VISIBLE, correct, estimate_exposure
from .effects.motion import Tracks, find_longest_tracks

MOTION_POINTS: Final = 600
"""Number of points, those seen in the most images, that suffice to find the effects of the camera's motion."""


Found = TypeVar("Found", MotionBlurFound, RollingShutterFound)


class SparseModel(NamedTuple):
    """The result of structure from motion for the undistorted images, as `io.colmap` reads it."""

    cameras: Sequence[Camera]
    """At the full size of the images."""
    tracks: dict[str, tuple[Float64, NDArray[np.int64]]]
    """Image -> (K, 2) px where it shows triangulated points, (K,) their numbers."""
    positions: tuple[NDArray[np.int64], Float64]
    """(P,) numbers of the points and (P, 3) su where they are."""


@dataclass(frozen=True)
class Capture:
    """The photos for training and those for judging."""

    views: list[View]
    """As filmed, in order of name."""
    training: list[View]
    """Corrected for the effects that are there."""
    held_out: list[View]
    """As filmed."""
    held_out_gains: list[Float64]
    """(3,) for each image; its render is multiplied by them. They come from the points in the judged image itself,
    because three numbers of an image do not test the model."""
    effects: Effects


def capture_of(
    views: list[View], model: SparseModel, frames: FramesInfo | None, sfm: SfmInfo | None, options: TrainOptions
) -> Capture:
    """Look for effects of the camera in photos, and correct those that are there (or that the options force).

    Args:
        views: in order of name.
        frames: for a video they also hold the times of the images; None if the cameras come from elsewhere than `sfm`.
    """
    decision, gains = _exposure(views, model, options)
    effects = Effects(decision, sfm.distortion if sfm else None, *_motion(views, model, _times(frames, views)))
    usable = [correct(view, gain) if (gain != 1).any() else view for view, gain in zip(views, gains, strict=True)]
    training, _ = hold_out(usable, options.holdout)
    _, held_out = hold_out(views, options.holdout)
    _, held_out_gains = hold_out(list(gains), options.holdout)
    return Capture(views, training, held_out, held_out_gains, effects)


def _exposure(views: list[View], model: SparseModel, options: TrainOptions) -> tuple[ExposureDecision, Float64]:
    """Whether the images are brought to a common exposure, and the gains (V, 3) of each.

    Held-out images affect neither the decision nor the gains of the others.
    """
    none, option = np.ones((len(views), 3)), options.exposure
    if option == "off":
        return ExposureDecision(option, on=False), none
    full = {camera.name: camera.width for camera in model.cameras}
    seen = [(view, *model.tracks[view.camera.name]) for view in views]
    places = [points_px * (view.camera.width / full[view.camera.name]) for view, points_px, _ in seen]
    fitted = np.zeros(len(views), bool)
    fitted[hold_out(list(range(len(views))), options.holdout)[0]] = True
    found = estimate_exposure(views, places, [numbers for _, _, numbers in seen], fitted)
    on = option == "on" or found.varies
    gains = found.gains if on else none
    decision = ExposureDecision(
        option,
        on,
        spread_pct=100 * found.spread,
        error_pct=100 * found.error,
        likeness=found.likeness,
        visible_from_pct=100 * VISIBLE,
        n_observations=found.n_observations,
        gains={view.camera.name: tuple(gain) for view, gain in zip(views, gains.tolist(), strict=True)},
    )
    return decision, gains


def _motion(
    views: list[View], model: SparseModel, times: Float64 | None
) -> tuple[MotionBlurFound | None, RollingShutterFound | None]:
    """The effects of the camera's motion on a video's images: reported, never modelled (docs/training.md says why)."""
    if times is None:
        return None, None
    tracks = _tracks(model, times)
    blur, shutter = blurring.estimate_motion_blur(views, tracks), rolling.estimate_rolling_shutter(tracks)
    lengths_px = {view.camera.name: length for view, length in zip(views, blur.lengths_px.tolist(), strict=True)}
    return (
        _found(MotionBlurFound, blur, visible_from_px=blurring.VISIBLE_PX, lengths_px=lengths_px),
        _found(RollingShutterFound, shutter, visible_from_px=rolling.VISIBLE_PX),
    )


def motion_blur_of(views: list[View], model: SparseModel, frames: FramesInfo) -> blurring.MotionBlur | None:
    """The motion blur from images alone, as `capture_of` finds it; None for photos.

    Args:
        views: of the model's cameras, in order of name.
    """
    times = _times(frames, views)
    return None if times is None else blurring.estimate_motion_blur(views, _tracks(model, times))


def _tracks(model: SparseModel, times: Float64) -> Tracks:
    return find_longest_tracks(model.cameras, times, model.tracks, model.positions, MOTION_POINTS)


def _found(kind: type[Found], estimate: object, **others: Any) -> Found:
    """An effect for the document: the estimate's values of the same names, and `others`."""
    names = {item.name for item in fields(kind)} - {"on", *others}
    return kind(on=False, **{name: getattr(estimate, name) for name in names}, **others)


def _times(frames: FramesInfo | None, views: list[View]) -> Float64 | None:
    """Times of the images, in frames of the video; None for photos and for cameras that come from elsewhere."""
    if frames is None or frames.video is None:
        return None
    taken_s = {image.name: image.timestamp_s for image in frames.images}
    times = frames.video.fps * np.array([taken_s.get(view.camera.name) for view in views], float)
    return times if len(times) > 2 and (np.diff(times) > 0).all() else None
