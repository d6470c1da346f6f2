# SPDX-License-Identifier: Apache-2.0
"""frames/frames.json: the images that were taken from a capture, with the facts about each."""

from __future__ import annotations

from dataclasses import dataclass

from ..io.ffmpeg_text import VideoFacts
from .document import Document


@dataclass(frozen=True)
class FrameInfo:
    """One image."""

    name: str
    source_index: int
    """Index of the video's frame, or of the photo in order of name."""
    sharpness: float
    blur: float
    mean_luminance: float
    highlight: float
    """Luminance that the brightest 2 % of the pixels exceed."""
    black_share: float
    white_share: float
    timestamp_s: float | None = None
    """Time of the frame in a video."""
    file: str | None = None
    """Name of the photo's file."""


@dataclass(frozen=True)
class VideoInfo(VideoFacts):
    """A video's header and the result of decoding it."""

    n_decoded: int
    n_intact: int
    blank: tuple[int, ...]
    """Frames that are black, white or empty."""
    repeated: tuple[int, ...]
    """Frames that repeat the one before."""


@dataclass(frozen=True)
class FramesInfo(Document):
    """The images that the stage frames took."""

    REMEDY = "run `cotton3dg frames --force`"

    source: str
    """`video` or `images`."""
    ordered: bool
    """Whether the images follow each other along the walk."""
    orientation: str
    """How rotation tags were handled."""
    images: tuple[FrameInfo, ...]
    """In order of time, or of name."""
    file: str | None = None
    """The video."""
    colour: str | None = None
    """How the video's colours were converted."""
    video: VideoInfo | None = None
    focal_length_px: float | None = None
    """Focal length of photos, from their EXIF; NaN where EXIF does not have it."""
