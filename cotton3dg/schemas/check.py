# SPDX-License-Identifier: Apache-2.0
"""check/check.json: the findings of a first look at a film, and whether to film again."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any, Final

from .document import Document
from .record import Record

GREEN: Final = "green"
YELLOW: Final = "yellow"
RED: Final = "red"
"""The film is good; it is usable, but something will be missing or doubtful; it cannot give a result."""
VERDICTS: Final = (GREEN, YELLOW, RED)
"""From good to bad."""


@dataclass(frozen=True)
class Finding:
    """The finding on one aspect of a film."""

    verdict: str
    topic: str
    text: str
    """The finding in words, with figures."""
    remedy: str = ""
    """What to do when filming again."""

    def __str__(self) -> str:
        return f"{self.text}; {self.remedy}" if self.remedy else self.text


@dataclass(frozen=True)
class CheckInfo(Document):
    """The result of the command check for a film."""

    REMEDY = "run `cotton3dg check`"

    verdict: str
    """`green`, `yellow` or `red`: the worst of the findings."""
    line: str
    """The verdict in one line, with what to film again."""
    findings: tuple[Finding, ...]
    """The worst first."""
    figures: dict[str, Any]
    """Figures by name with their unit; those that were not measured are missing."""
    seconds: float
    film: str = ""
    """`film_of` applied to the record of its frames."""


def film_of(frames: Record | None) -> str:
    """SHA-256 that identifies a film, from the files that the stage frames read."""
    return hashlib.sha256(repr(sorted(frames.inputs.items())).encode()).hexdigest() if frames else ""
