"""The videos that were read for a field, as its folder keeps them."""

from __future__ import annotations

from dataclasses import dataclass, field

from .document import Document


@dataclass(frozen=True)
class ReadVideo:
    """The codes in one video."""

    codes: dict[str, int] = field(default_factory=dict)
    """Text of a code -> number of frames in which it was read."""
    frames: int = 0
    """Number of frames in which codes were searched."""
    problem: str = ""
    """The reason if the video could not be read."""


@dataclass(frozen=True)
class ReadVideos(Document):
    """.import.json of a field."""

    REMEDY = "delete it; the videos are then read again"

    videos: dict[str, ReadVideo] = field(default_factory=dict)
    """Videos by the fingerprint of the file."""
