"""The report of a stage on its run, besides the files that it wrote."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class StageOutcome:
    """Kept in `records/<stage>.json`; the flags end in the qc_flags column of traits.csv."""

    summary: dict[str, Any] = field(default_factory=dict)
    """Figures with units in their names; the first few are shown on the terminal."""
    flags: tuple[str, ...] = ()
    """Quality flags in snake_case, e.g. `few_frames_registered`."""
    warnings: tuple[str, ...] = ()
    """One-line sentences for the user: what is doubtful and what to do."""
    parts_s: dict[str, float] = field(default_factory=dict)
    """Seconds that its parts took."""
