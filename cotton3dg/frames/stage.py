# SPDX-License-Identifier: Apache-2.0
"""frames: sharp, evenly spaced images from the plant's video or photos."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from ..core.runs import Progress, StageOutcome
from ..errors import as_capture_failure
from ..io.images import list_images, write_image
from ..options import FramesOptions
from ..stage import Cost, Stage, Work
from ..workspace import Workspace
from .frame_statistics import Picture, outcome_of
from .take_photos import take_photos
from .take_video import HELD_A_FRAME, take_video

JPEG_BYTES_A_PIXEL: Final = 1.0
"""At quality 97 without chroma subsampling, of footage rich in detail; 0.6 is usual."""
HELD_BYTES_A_PIXEL: Final = 1.5
"""Bytes of a frame that is held until the film's end; HDR takes twice as much."""


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.capture()]


def run(workspace: Workspace, options: FramesOptions, progress: Progress) -> StageOutcome:
    """Writes 000000.jpg and so on, and frames.json.

    Raises:
        CaptureFailed: the video or a photo cannot be used.
    """
    source = workspace.capture()
    with workspace.writing("frames") as folder:

        def keep(name: str, image: Picture) -> None:
            write_image(folder / name, image)

        with as_capture_failure():
            if source.is_dir():
                taken = take_photos(source, options, keep, progress)
            else:
                taken = take_video(source, options, keep, progress, folder)
        outcome = outcome_of(taken)
        if source.is_file():
            outcome = replace(outcome, warnings=(*outcome.warnings, *_unused_photos(workspace, source)))
        taken.info.save(folder / workspace.frames_json.name)
    return outcome


def _unused_photos(workspace: Workspace, video: Path) -> list[str]:
    """A remark on photos in the plant's folder or in its images folder, which a video there leaves unused."""
    folders = [folder for folder in (workspace.root, workspace.images_input) if folder.is_dir()]
    if not (photos := [photo for folder in folders for photo in list_images(folder)]):
        return []
    found = f"{len(photos)} photos beside {video.name}, e.g. {photos[0].name}, are not used"
    return [f"{found}; to use photos, put the video elsewhere and the photos into a folder named images"]


def _disk_bytes(_: Workspace, options: FramesOptions) -> float:
    pixels = options.count * options.max_side**2 * 9 / 16
    return pixels * (JPEG_BYTES_A_PIXEL + HELD_A_FRAME * HELD_BYTES_A_PIXEL)


def _cost(work: Work) -> Cost:
    """Every frame of the capture is decoded once; those that are kept are saved."""
    mp = work.source.width * work.source.height / 1e6
    return Cost(
        2.5 + 0.006 * work.source.frames * mp + 0.015 * work.images * work.megapixels(work.options["frames"].max_side)
    )


STAGE: Final = Stage(
    "frames",
    version=6,
    inputs=inputs,
    run=run,
    cost=_cost,
    disk_bytes=_disk_bytes,
    droppable=lambda workspace: workspace.frame_images(),
)
