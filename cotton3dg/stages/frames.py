"""frames: sharp, evenly spaced images from the plant's video or photos."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..capture import frame_quality
from ..core.outcome import StageOutcome
from ..core.progress import Progress
from ..documents.frames import FrameInfo, FramesInfo, VideoInfo
from ..errors import BadInput, CaptureFailed
from ..files import images, video
from ..options import FramesOptions
from ..workspace import Workspace
from .stage import Cost, Stage, Work

Picture = NDArray[np.uint8]

SCAN_SIDE = 640
"""Frames are judged at this size, px."""
MIN_VIDEO_S = 2.0
MIN_FRAMES = 20
MIN_PHOTOS = 8
MIN_INTACT_SHARE = 0.8
JPEG_BYTES_A_PIXEL = 1.0
"""At quality 97 without chroma subsampling, of footage rich in detail; 0.6 is usual."""
ORIENTATION_RULE = "rotation tags and EXIF orientation are applied to the pixels; the images carry no tag"


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.capture()]


def run(workspace: Workspace, options: FramesOptions, progress: Progress) -> StageOutcome:
    source = workspace.capture()
    with workspace.writing("frames") as folder:
        take = _from_photos if source.is_dir() else _from_video
        taken = take(source, options, folder, progress)
        outcome = _judged(taken)
        taken.info.save(folder / workspace.frames_json.name)
    return outcome


@dataclass(frozen=True)
class _Taken:
    """The images of one capture, as written, and what is to be said about them."""

    info: FramesInfo
    motions: tuple[float, ...]
    flags: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def _from_video(path: Path, options: FramesOptions, folder: Path, progress: Progress) -> _Taken:
    facts = video.probe(path)
    n_expected = round(facts.duration_s * facts.fps) if facts.duration_s * facts.fps > 0 else 0
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
    for flag, found, what in (
        ("blank_frames", blank, "black, white or empty"),
        ("repeated_frames", repeated, "repeats"),
    ):
        if found.any():
            flags += (flag,)
            warnings += (f"{found.sum()} of {len(found)} frames are {what} and were left out",)
    usable = scan.intact & ~blank & ~repeated
    indices = frame_quality.spread_frames(scan.timestamps_s, scores, usable, options.count)
    if len(indices) < min(options.count, MIN_FRAMES):
        raise CaptureFailed(f"{path.name}: {len(indices)} usable frames; film at least {MIN_VIDEO_S:g} s")
    if len(indices) < options.count:
        flags += ("few_frames",)
        warnings += (f"{len(indices)} frames instead of {options.count}; film longer for more",)

    def saved(done: int, total: int, remark: str = "") -> None:
        # Saving decodes the video once more.
        n = max(n_expected, n_scanned)
        progress(n + round(n * done / total), 2 * n, remark)

    entries, motions = _written(video.read_frames(path, facts, indices, options.max_side), indices, folder, saved)
    info = FramesInfo(
        source="video",
        file=path.name,
        ordered=True,
        orientation=ORIENTATION_RULE,
        colour=f"{facts.transfer} tone-mapped to sRGB" if facts.is_hdr else "as filmed",
        video=VideoInfo(
            **asdict(facts),
            n_decoded=len(scan.intact),
            n_intact=int(scan.intact.sum()),
            blank=tuple(np.flatnonzero(blank).tolist()),
            repeated=tuple(np.flatnonzero(repeated).tolist()),
        ),
        images=tuple(
            replace(entry, timestamp_s=round(float(scan.timestamps_s[entry.source_index]), 6)) for entry in entries
        ),
    )
    return _Taken(info, motions, flags, warnings)


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


def _from_photos(source: Path, options: FramesOptions, folder: Path, progress: Progress) -> _Taken:
    found = images.list_images(source)
    if len(found) < MIN_PHOTOS:
        raise CaptureFailed(
            f"{len(found)} photos in {source.name} ({MIN_PHOTOS} needed); take some 50 all around the plant"
        )
    indices = frame_quality.spread_indices(len(found), options.count)
    focal_lengths_px: list[float | None] = []

    def pictures() -> Iterator[Picture]:
        shape: tuple[int, ...] = ()
        for index in indices:
            picture = images.read_image(found[index])
            if shape and picture.shape != shape:
                raise BadInput(
                    f"{found[index].name} is {picture.shape[1]} x {picture.shape[0]} px, those before are"
                    f" {shape[1]} x {shape[0]}; keep photos of one camera and orientation"
                )
            shape = picture.shape
            small = images.scale_down(picture, options.max_side)
            if not focal_lengths_px:
                focal_px = images.exif_focal_length_px(found[index])
                focal_lengths_px.append(focal_px and focal_px * max(small.shape) / max(shape))
            yield small

    entries, motions = _written(pictures(), indices, folder, progress)
    few = len(indices) < len(found)
    info = FramesInfo(
        source="images",
        ordered=False,
        orientation=ORIENTATION_RULE,
        focal_length_px=focal_lengths_px[0] or math.nan,
        images=tuple(replace(entry, file=found[entry.source_index].name) for entry in entries),
    )
    warning = f"{len(indices)} of {len(found)} photos are used; raise frames.count to use more"
    return _Taken(info, motions, warnings=(warning,) if few else ())


def _written(
    pictures: Iterator[Picture], indices: list[int], folder: Path, progress: Progress
) -> tuple[list[FrameInfo], tuple[float, ...]]:
    """Save RGB images one by one; what there is to know of each, and the motion from each to the next."""
    import cv2

    entries: list[FrameInfo] = []
    motions: list[float] = []
    before: Picture | None = None
    for number, (index, picture) in enumerate(zip(indices, pictures, strict=True)):
        name = f"{number:06d}.jpg"
        images.write_image(folder / name, picture)
        grey = cv2.cvtColor(images.scale_down(picture, SCAN_SIDE), cv2.COLOR_RGB2GRAY)
        luminance, black, white = frame_quality.measure_exposure(grey)
        entries.append(
            FrameInfo(
                name,
                source_index=index,
                sharpness=round(frame_quality.sharpness(grey), 3),
                blur=round(frame_quality.blur(grey), 4),
                mean_luminance=round(luminance, 4),
                black_share=round(black, 4),
                white_share=round(white, 4),
            )
        )
        if before is not None:
            motions.append(frame_quality.measure_displacement(before, grey))
        before = grey
        progress(number + 1, len(indices), "saving frames")
    return entries, tuple(motions)


def _judged(taken: _Taken) -> StageOutcome:
    """What the images themselves say about the capture.

    Raises:
        CaptureFailed: the camera did not move.
    """
    if frame_quality.stands_still(taken.motions):
        raise CaptureFailed("the camera stands still; film one slow full turn around the plant")
    entries = taken.info.images
    medians = {
        key: float(np.median([getattr(entry, key) for entry in entries]))
        for key in ("blur", "mean_luminance", "white_share")
    }
    concerns = frame_quality.raise_concerns(medians["blur"], medians["mean_luminance"], medians["white_share"])
    return StageOutcome(
        summary={"n_frames": len(entries), **{key: round(value, 3) for key, value in medians.items()}},
        flags=(*taken.flags, *concerns),
        warnings=(*taken.warnings, *concerns.values()),
    )


def _disk_bytes(_: Workspace, options: FramesOptions) -> float:
    return options.count * options.max_side**2 * 9 / 16 * JPEG_BYTES_A_PIXEL


def _cost(work: Work) -> Cost:
    """Every frame of the capture is decoded twice."""
    return Cost(2.5 + 0.045 * work.source.frames * work.source.width * work.source.height / 1e6)


STAGE = Stage(
    "frames",
    version=2,
    inputs=inputs,
    run=run,
    cost=_cost,
    disk_bytes=_disk_bytes,
    droppable=lambda workspace: workspace.frame_images(),
)
