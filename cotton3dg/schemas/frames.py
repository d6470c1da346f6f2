"""frames/frames.json: which images were taken from a capture, and what each is like."""

from __future__ import annotations

from dataclasses import dataclass

from ..io.ffmpeg_text import VideoFacts
from .document import Document


@dataclass(frozen=True)
class FrameInfo:
    """One image."""

    name: str
    source_index: int
    """Of the video's frame, or of the photo in order of name."""
    sharpness: float
    blur: float
    mean_luminance: float
    highlight: float
    """Luminance that the brightest 2 % of the pixels exceed."""
    black_share: float
    white_share: float
    timestamp_s: float | None = None
    """Of a video."""
    file: str | None = None
    """Of the photo that it is."""


@dataclass(frozen=True)
class VideoInfo(VideoFacts):
    """A video's header and what decoding it showed."""

    n_decoded: int
    n_intact: int
    blank: tuple[int, ...]
    """Frames that are black, white or empty."""
    repeated: tuple[int, ...]
    """Frames that repeat the one before."""


@dataclass(frozen=True)
class FramesInfo(Document):
    """What the stage frames took."""

    REMEDY = "run `cotton3dg frames --force`"

    source: str
    """`video` or `images`."""
    ordered: bool
    """Whether the images follow each other along the walk."""
    orientation: str
    """What became of rotation tags."""
    images: tuple[FrameInfo, ...]
    """In order of time, or of name."""
    file: str | None = None
    """The video."""
    colour: str | None = None
    """What was done to the video's colours."""
    video: VideoInfo | None = None
    focal_length_px: float | None = None
    """Of photos, by their EXIF; NaN where that says nothing."""
