"""Files of a batch: the outcome of each plant, and the cluster job that works on it."""

from __future__ import annotations

from dataclasses import dataclass
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
