# SPDX-License-Identifier: Apache-2.0
"""What a run of a stage tells its caller: how far it is, where its time goes, its outcome and its state."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol


class State(StrEnum):
    """The state of a stage, of a plant in a batch or of a setting in a study; tables and `status --json` show it."""

    DONE = "done"
    FAILED = "failed"
    STALE = "stale"
    """Done, but a new run would give another result."""
    MISSING = "missing"
    """Never done."""
    WAITING = "waiting"
    """Not tried yet."""
    SKIPPED = "skipped"
    """Not tried, and it will not be."""


class Progress(Protocol):
    """Called with the number of finished units, the total, and a short remark for the display."""

    def __call__(self, done: int, total: int, remark: str = "") -> None: ...


def silent(done: int, total: int, remark: str = "") -> None:
    """The progress of a caller that does not watch."""


class Stopwatch:
    """Seconds since its creation or its last lap, by the name of the part."""

    def __init__(self) -> None:
        self.parts_s: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, part: str) -> None:
        """Add the time since the last lap to this part; parts of one name add up."""
        now = time.perf_counter()
        self.parts_s[part] = round(self.parts_s.get(part, 0.0) + now - self._last, 3)
        self._last = now


@dataclass(frozen=True)
class StageOutcome:
    """What a stage reports besides its files: `records/<stage>.json` keeps it, and qc_flags of traits.csv the flags."""

    summary: dict[str, Any] = field(default_factory=dict)
    """Figures with units in their names; the first few are shown on the terminal."""
    flags: tuple[str, ...] = ()
    """Quality flags in snake_case, e.g. `few_frames_registered`."""
    warnings: tuple[str, ...] = ()
    """One-line sentences for the user: what is doubtful and what to do."""
    parts_s: dict[str, float] = field(default_factory=dict)
    """Seconds that its parts took."""
