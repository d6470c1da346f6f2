"""check/check.json: what a first look at a film found, and whether to film again."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any, Final

from .document import Document
from .record import Record

GREEN: Final = "green"
YELLOW: Final = "yellow"
RED: Final = "red"
"""Good as it is; usable, but something will be missing or doubtful; no result can come of it."""
VERDICTS: Final = (GREEN, YELLOW, RED)
"""From good to bad."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    verdict: str
    topic: str
    text: str
    """With figures."""
    remedy: str = ""
    """What to do when filming again."""

    def __str__(self) -> str:
        return f"{self.text}; {self.remedy}" if self.remedy else self.text


@dataclass(frozen=True)
class CheckInfo(Document):
    """What the command check says of a film."""

    REMEDY = "run `cotton3dg check`"

    verdict: str
    """`green`, `yellow` or `red`: the worst of the findings."""
    line: str
    """The verdict in one line, with what to film again."""
    findings: tuple[Finding, ...]
    """The worst first."""
    figures: dict[str, Any]
    """By name with its unit; what was not measured is missing."""
    seconds: float
    film: str = ""
    """`film_of` the record of its frames."""


def film_of(frames: Record | None) -> str:
    """SHA-256 that tells one film from another: of what the stage frames read."""
    return hashlib.sha256(repr(sorted(frames.inputs.items())).encode()).hexdigest() if frames else ""
