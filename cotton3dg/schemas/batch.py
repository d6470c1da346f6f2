"""Files of a batch: what became of a plant, and which job of a cluster works on which."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from .document import Document, WholeDocument

REMEDY: Final = "submit the batch again"


@dataclass(frozen=True)
class PlantOutcome(Document):
    """records/batch.json of a plant, which its job leaves."""

    REMEDY = REMEDY

    folder: str
    """Of the plant, relative to the batch's."""
    state: str
    """As `core.state.State` has it."""
    exit_code: int | None = None
    reason: str = ""


@dataclass(frozen=True)
class Jobs(WholeDocument):
    """.slurm/jobs.json of a batch."""

    REMEDY = REMEDY

    of_plants: dict[str, str]
    """The plant's folder -> the id of the job that was submitted for it last."""
