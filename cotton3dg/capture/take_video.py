"""Sharp, evenly spaced images from a video."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.progress import Progress
from ..documents.frames import FrameInfo, FramesInfo, VideoInfo
from ..errors import BadInput, CaptureFailed
from ..files import video
from ..options import FramesOptions
from . import frame_quality
from .taken import ORIENTATION_RULE, SCAN_SIDE, Keep, Picture, Taken, keep_all

MIN_VIDEO_S = 2.0
MIN_FRAMES = 20
MIN_INTACT_SHARE = 0.8


@dataclass(frozen=True)
class _Scanned:
    """What decoding the whole video showed of each frame."""

    scan: video.Scan[tuple[float, float, float]]
    scores: NDArray[np.float64]
    """Sharpness."""
    blank: NDArray[np.bool_]
    """Black, white or empty."""
    repeated: NDArray[np.bool_]
    flags: tuple[str, ...]
    warnings: tuple[str, ...]


def take_video(path: Path, options: FramesOptions, keep: Keep, progress: Progress) -> Taken:
    """Take the sharpest frames at even intervals of time.

    Raises:
        BadInput: the video cannot be decoded, or too little of it.
        CaptureFailed: it is too short, or has too few usable frames.
    """
    facts = video.probe(path)
    n_expected = round(facts.duration_s * facts.fps) if facts.duration_s * facts.fps > 0 else 0
    found = _scanned(path, facts, n_expected, progress)
    scan, flags, warnings = found.scan, found.flags, found.warnings
    usable = scan.intact & ~found.blank & ~found.repeated
    indices = frame_quality.spread_frames(scan.timestamps_s, found.scores, usable, options.count)
    if len(indices) < min(options.count, MIN_FRAMES):
        raise CaptureFailed(f"{path.name}: {len(indices)} usable frames; film at least {MIN_VIDEO_S:g} s")
    if len(indices) < options.count:
        flags += ("few_frames",)
        warnings += (f"{len(indices)} frames instead of {options.count}; film longer for more",)

    def saved(done: int, total: int, remark: str = "") -> None:
        # Saving decodes the video once more.
        n = max(n_expected, len(scan.measures))
        progress(n + round(n * done / total), 2 * n, remark)

    entries, motions = keep_all(video.read_frames(path, facts, indices, options.max_side), indices, keep, saved)
    return Taken(_info(path, facts, found, entries), motions, flags, warnings)


def _scanned(path: Path, facts: video.VideoFacts, n_expected: int, progress: Progress) -> _Scanned:
    """Look at every frame, small."""
    n_scanned, before = 0, None

    def measure(grey: Picture) -> tuple[float, float, float]:
        nonlocal n_scanned, before
        n_scanned += 1
        progress(n_scanned, 2 * max(n_expected, n_scanned), "looking for sharp frames")
        measures = frame_quality.sharpness(grey), frame_quality.contrast(grey), frame_quality.change(before, grey)
        before = grey
        return measures

    scan = video.scan(path, facts, SCAN_SIDE, measure)
    flags, warnings = _checked_scan(path, facts, scan)
    scores, contrasts, changes = np.array(scan.measures).T
    blank, repeated = frame_quality.find_blank_and_repeated(contrasts, changes)
    for flag, which, what in (
        ("blank_frames", blank, "black, white or empty"),
        ("repeated_frames", repeated, "repeats"),
    ):
        if which.any():
            flags += (flag,)
            warnings += (f"{which.sum()} of {len(which)} frames are {what} and were left out",)
    return _Scanned(scan, scores, blank, repeated, flags, warnings)


def _info(path: Path, facts: video.VideoFacts, found: _Scanned, entries: list[FrameInfo]) -> FramesInfo:
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
            blank=tuple(np.flatnonzero(found.blank).tolist()),
            repeated=tuple(np.flatnonzero(found.repeated).tolist()),
        ),
        images=tuple(
            replace(entry, timestamp_s=round(float(scan.timestamps_s[entry.source_index]), 6)) for entry in entries
        ),
    )


def _checked_scan(
    path: Path, facts: video.VideoFacts, scan: video.Scan[tuple[float, float, float]]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Flags and warnings of a video that was decoded, or the reason why it cannot be used."""
    n, n_intact = len(scan.intact), int(scan.intact.sum())
    if n_intact == 0:
        raise BadInput(f"{path.name}: no frame can be decoded; copy it again from the phone")
    times = scan.timestamps_s[np.isfinite(scan.timestamps_s)]
    length_s = float(times.max() - times.min()) * (1 + 1 / max(1, len(times) - 1))
    # A header without a duration cannot say that something is missing.
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
