# SPDX-License-Identifier: Apache-2.0
"""The images taken from a capture. They are measured one by one, as they are too many to be held together."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.machine import stream_on_all_cores
from ..core.runs import Progress, StageOutcome
from ..errors import CaptureFailed
from ..io.images import scale_down
from ..schemas.frames import FrameInfo, FramesInfo
from . import frame_quality

Picture = NDArray[np.uint8]
"""(H, W, 3) RGB, or (H, W) grey."""
Keep = Callable[[str, Picture], None]
"""Saves an image under a name."""

SCAN_SIDE: Final = 640
"""Images are judged at this size, px, ..."""
MOTION_SIDE: Final = 320
"""... and motion from one to the next is looked for at this one."""
STANDS_STILL: Final = "the camera stands still; film one slow full turn around the plant"
ORIENTATION_RULE: Final = "rotation tags and EXIF orientation are applied to the pixels; the images carry no tag"


@dataclass(frozen=True)
class Taken:
    """The kept images of one capture, and the flags and warnings about them."""

    info: FramesInfo
    motions: tuple[float, ...]
    """From each image to the next, as `frame_quality.displacement` measures it."""
    flags: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def keep_all(
    pictures: Iterator[Picture], indices: list[int], keep: Keep, progress: Progress
) -> tuple[list[FrameInfo], tuple[float, ...]]:
    """Keep RGB images as they come; the facts about each, and the motion from each to the next."""
    entries: list[FrameInfo] = []
    motions: list[float] = []
    before: Picture | None = None
    names = (f"{number:06d}.jpg" for number in range(len(indices)))
    taken = stream_on_all_cores(lambda given: _kept(*given, keep), zip(names, indices, pictures, strict=True))
    for entry, small in taken:
        entries.append(entry)
        if before is not None:
            motions.append(frame_quality.measure_displacement(before, small))
        before = small
        progress(len(entries), len(indices), "saving frames")
    return entries, tuple(motions)


def _kept(name: str, index: int, picture: Picture, keep: Keep) -> tuple[FrameInfo, Picture]:
    """The facts about a kept image, and the image, grey and small, in which motion is looked for."""
    import cv2

    keep(name, picture)
    grey = cv2.cvtColor(scale_down(picture, SCAN_SIDE), cv2.COLOR_RGB2GRAY)
    luminance, highlight, black, white = frame_quality.measure_exposure(grey)
    entry = FrameInfo(
        name,
        source_index=index,
        sharpness=round(frame_quality.sharpness(grey), 3),
        blur=round(frame_quality.blur(grey), 4),
        mean_luminance=round(luminance, 4),
        highlight=round(highlight, 4),
        black_share=round(black, 4),
        white_share=round(white, 4),
    )
    return entry, scale_down(grey, MOTION_SIDE)


def outcome_of(taken: Taken) -> StageOutcome:
    """The flags and warnings that follow from the images themselves.

    Raises:
        CaptureFailed: the camera did not move.
    """
    if frame_quality.stands_still(taken.motions):
        raise CaptureFailed(STANDS_STILL)
    entries = taken.info.images
    medians = {
        key: float(np.median([getattr(entry, key) for entry in entries]))
        for key in ("blur", "mean_luminance", "highlight", "white_share")
    }
    concerns = frame_quality.quality_flags(medians["blur"], medians["highlight"], medians["white_share"])
    return StageOutcome(
        summary={"n_frames": len(entries), **{key: round(value, 3) for key, value in medians.items()}},
        flags=(*taken.flags, *concerns),
        warnings=(*taken.warnings, *concerns.values()),
    )
