# SPDX-License-Identifier: Apache-2.0
"""Files of a folder of plants: the videos that were read for it, the outcome of each plant, and its cluster job."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from .document import Document, WholeDocument

REMEDY: Final = "submit the batch again"


@dataclass(frozen=True)
class PlantOutcome(Document):
    """records/batch.json of a plant, which its job writes."""

    REMEDY = REMEDY

    folder: str
    """Folder of the plant, relative to that of the batch."""
    state: str
    """One of `core.runs.State`."""
    exit_code: int | None = None
    reason: str = ""


@dataclass(frozen=True)
class Jobs(WholeDocument):
    """.slurm/jobs.json of a batch."""

    REMEDY = REMEDY

    of_plants: dict[str, str]
    """The plant's folder -> the id of the last job that was submitted for it."""


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
    """.import.json of a field: the videos that were read for it."""

    REMEDY = "delete it; the videos are then read again"

    videos: dict[str, ReadVideo] = field(default_factory=dict)
    """Videos by the fingerprint of the file."""
