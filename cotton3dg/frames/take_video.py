# SPDX-License-Identifier: Apache-2.0
"""Sharp images from a video, at even steps of the camera's way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, astuple, dataclass, replace
from itertools import count
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.runs import Progress
from ..errors import BadInput, CaptureFailed
from ..io import video
from ..io.ffmpeg_text import VideoFacts
from ..io.yuv import YuvFrame
from ..options import FramesOptions
from ..schemas.frames import FrameInfo, FramesInfo, VideoInfo
from . import frame_quality
from .camera_travel import WayMeter
from .frame_statistics import ORIENTATION_RULE, SCAN_SIDE, STANDS_STILL, Keep, Picture, Taken, keep_all
from .keyframe_buffer import HeldFrames, select_keyframes

MIN_VIDEO_S: Final = 2.0
MIN_FRAMES: Final = 20
MIN_INTACT_SHARE: Final = 0.8
HELD_A_FRAME: Final = 2
"""Frames held for each that is wanted."""
LOOKED_AT: Final = 4
"""Least number of measured frames for each wanted one: of a long film or a fast one only every n-th is measured, ..."""
LEAST_FPS: Final = 12.0
"""... but never fewer a second, so that corners can be followed."""
NO_WAY: Final = 0.02
"""A camera that goes no farther than this, in sides of the image, stands still."""
SAVING_SHARE: Final = 0.3
"""Time for saving relative to the time for decoding, roughly."""


@dataclass(frozen=True)
class _Measures:
    """Measures of one frame."""

    sharpness: float
    contrast: float
    change: float
    way: float


@dataclass(frozen=True)
class _Scanned:
    """The result of decoding the whole video, for each measured frame."""

    scan: video.Scan[_Measures]
    frames: NDArray[np.int64]
    """Their numbers among all frames."""
    scores: NDArray[np.float64]
    """Sharpness."""
    ways: NDArray[np.float64]
    blank: NDArray[np.bool_]
    """Black, white or empty."""
    repeated: NDArray[np.bool_]
    flags: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def intact(self) -> NDArray[np.bool_]:
        return self.scan.intact[self.frames]


def take_video(path: Path, options: FramesOptions, keep: Keep, progress: Progress, folder: Path) -> Taken:
    """Take sharp frames at even steps of the camera's way, while the video is decoded once.

    The damage of a video is known only in the end; then frames are chosen from all and read once more.

    Args:
        folder: on a disk with room for some frames.
    Raises:
        BadInput: the video cannot be decoded, or too little of it.
        CaptureFailed: it is too short, the camera stands still, or there are too few usable frames.
    """
    facts = video.probe(path)
    n_expected = round(facts.duration_s * facts.fps) if facts.duration_s * facts.fps > 0 else 0
    coding = video.coding_of(facts, options.max_side)
    held = HeldFrames(HELD_A_FRAME * options.count, coding.size, coding.kind, folder)
    found = _scanned(path, facts, options.max_side, held, n_expected, options.count, progress)
    usable = found.intact & ~found.blank
    if found.intact.all():
        usable &= np.isin(found.frames, held.frames)
    rows = np.flatnonzero(usable)
    rows = rows[select_keyframes(found.ways[rows], found.scores[rows], options.count)]
    indices = found.frames[rows].tolist()
    flags, warnings = found.flags, found.warnings
    if facts.rivals:
        size = f"{facts.width} x {facts.height} px"
        warnings += (f"{path.name} holds {facts.rivals + 1} films; stream {facts.stream} is taken ({size})",)
    if len(indices) < min(options.count, MIN_FRAMES):
        reason = f"{path.name}: {len(indices)} usable frames; film at least {MIN_VIDEO_S:g} s"
        raise CaptureFailed(STANDS_STILL if found.ways[-1] < NO_WAY else reason)
    if len(indices) < options.count:
        flags += ("few_frames",)
        warnings += (f"{len(indices)} frames instead of {options.count}; film longer for more",)

    def saved(done: int, total: int, remark: str = "") -> None:
        n = max(n_expected, len(found.scan.intact))
        progress(n + round(SAVING_SHARE * n * done / total), n + round(SAVING_SHARE * n), remark)

    pictures: Iterator[Picture] = (YuvFrame(coding, held.numbers_of(index)).rgb() for index in indices)
    if not found.intact.all():
        pictures = video.read_frames(path, facts, indices, options.max_side)
    entries, motions = keep_all(pictures, indices, keep, saved)
    return Taken(_info(path, facts, found, entries), motions, flags, warnings)


def _scanned(
    path: Path,
    facts: VideoFacts,
    max_side: int,
    held: HeldFrames,
    n_expected: int,
    wanted: int,
    progress: Progress,
) -> _Scanned:
    """Measure the frames at a small size, and hold the best of them."""
    before: Picture | None = None
    meter = WayMeter()
    every = _looked_at_every(facts.fps, n_expected, wanted)
    numbers = count(0, every)

    def measure(frame: YuvFrame) -> _Measures:
        nonlocal before
        number = next(numbers)
        n = max(n_expected, number + 1)
        progress(number + 1, n + round(SAVING_SHARE * n), "looking for sharp frames")
        grey = frame.grey(SCAN_SIDE)
        contrast = frame_quality.contrast(grey)
        found = _Measures(frame_quality.sharpness(grey), contrast, frame_quality.change(before, grey), meter.add(grey))
        before = grey
        # A blank frame is never better than one that shows something.
        score = found.sharpness if contrast >= frame_quality.BLANK_CONTRAST else found.sharpness - 1e9
        held.offer(number, found.way, score, frame.numbers)
        return found

    scan = video.scan(path, facts, max_side, measure, every)
    flags, warnings = _checked_scan(path, facts, scan)
    frames = every * np.arange(len(scan.measures))
    scores, contrasts, changes, ways = np.array([astuple(measures) for measures in scan.measures]).T
    blank, repeated = frame_quality.find_blank_and_repeated(contrasts, changes)
    for flag, which, what in (
        ("blank_frames", blank, "black, white or empty"),
        ("repeated_frames", repeated, "repeats"),
    ):
        if which.any():
            flags += (flag,)
            warnings += (f"{which.sum()} of {len(which)} frames are {what} and were left out",)
    return _Scanned(scan, frames, scores, ways, blank, repeated, flags, warnings)


def _looked_at_every(fps: float, n_expected: int, wanted: int) -> int:
    """The number n for which every n-th frame is measured, of about `n_expected` frames, if `wanted` are to be kept."""
    if not fps > 0:
        return 1
    return max(1, min(n_expected // (LOOKED_AT * wanted), round(fps / LEAST_FPS)))


def _info(path: Path, facts: VideoFacts, found: _Scanned, entries: list[FrameInfo]) -> FramesInfo:
    scan = found.scan
    return FramesInfo(
        source="video",
        file=path.name,
        ordered=True,
        orientation=ORIENTATION_RULE,
        colour=f"{facts.transfer} tone-mapped to sRGB" if facts.is_hdr else "as filmed",
        video=VideoInfo(
            **asdict(facts),
            n_decoded=len(scan.intact),
            n_intact=int(scan.intact.sum()),
            blank=tuple(found.frames[found.blank].tolist()),
            repeated=tuple(found.frames[found.repeated].tolist()),
        ),
        images=tuple(
            replace(entry, timestamp_s=round(float(scan.timestamps_s[entry.source_index]), 6)) for entry in entries
        ),
    )


def _checked_scan(
    path: Path, facts: VideoFacts, scan: video.Scan[_Measures]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Flags and warnings of a video that was decoded, or the reason why it cannot be used."""
    n, n_intact = len(scan.intact), int(scan.intact.sum())
    if n_intact == 0:
        raise BadInput(f"{path.name}: no frame can be decoded; copy it again from the phone")
    times = scan.timestamps_s[np.isfinite(scan.timestamps_s)]
    length_s = float(times.max() - times.min()) * (1 + 1 / max(1, len(times) - 1))
    # A header without a duration does not show that something is missing.
    claimed_s = facts.duration_s if facts.duration_s > 0 else length_s
    share = (length_s / claimed_s if claimed_s > 0 else 1.0) * (1 - scan.n_damaged / n)
    if share < MIN_INTACT_SHARE and claimed_s >= MIN_VIDEO_S:
        raise BadInput(
            f"{path.name} is damaged: {n_intact} intact frames ({share:.0%} of {claimed_s:.1f} s,"
            f" {MIN_INTACT_SHARE:.0%} needed); copy it again from the phone"
        )
    if length_s < MIN_VIDEO_S or n_intact < MIN_FRAMES:
        raise CaptureFailed(
            f"{path.name} is too short: {length_s:.1f} s, {n_intact} frames ({MIN_VIDEO_S:g} s and {MIN_FRAMES} frames"
            " needed); film one slow full turn around the plant"
        )
    if scan.errors or share < 0.97:
        return ("video_damaged",), (f"{path.name}: only {share:.0%} can be decoded intact; copy it again if you can",)
    return (), ()
