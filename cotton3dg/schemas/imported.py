"""What a field's folder remembers of the videos that were read for it."""

from __future__ import annotations

from dataclasses import dataclass, field

from .document import Document


@dataclass(frozen=True)
class ReadVideo:
    """The codes in one video."""

    codes: dict[str, int] = field(default_factory=dict)
    """Text of a code -> frames that read it."""
    frames: int = 0
    """That were looked at."""
    problem: str = ""
    """Why it could not be read."""


@dataclass(frozen=True)
class ReadVideos(Document):
    """.import.json of a field."""

    REMEDY = "delete it; the videos are then read again"

    videos: dict[str, ReadVideo] = field(default_factory=dict)
    """By fingerprint of the file."""
