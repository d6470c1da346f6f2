"""records/<stage>.json: the options of a stage's run, the files that it read and wrote, and its outcome."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Final

from ..core.runs import StageOutcome
from .document import Document

OK: Final = "ok"
FAILED: Final = "failed"


@dataclass(frozen=True)
class Record(Document):
    """The last run of a stage. An unreadable record counts as missing, and its stage as stale."""

    REMEDY = "run `cotton3dg run`, which makes it again"

    stage: str
    status: str = FAILED
    """`ok` or `failed`."""
    stage_version: int = 0
    cotton3dg_version: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    reason: str = ""
    """The reason for the run."""
    inputs: dict[str, str] = field(default_factory=dict)
    """SHA-256 of the files that it read, by path as `Workspace.hashes` names it."""
    outputs: dict[str, str] = field(default_factory=dict)
    """SHA-256 of the files that it wrote."""
    summary: dict[str, Any] = field(default_factory=dict)
    flags: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    parts_s: dict[str, float] = field(default_factory=dict)
    """Seconds of its parts, if the stage reports them."""
    cpu_seconds: float = 0.0
    peak_memory_mib: float = 0.0
    error: str | None = None
    """The reason of a failure."""
    exit_code: int | None = None
    """Exit code of a command with this failure."""

    @property
    def is_ok(self) -> bool:
        return self.status == OK

    def done(self, outcome: StageOutcome, outputs: dict[str, str]) -> Record:
        """This record of a run that has ended well."""
        return replace(
            self,
            status=OK,
            outputs=outputs,
            summary=outcome.summary,
            flags=outcome.flags,
            warnings=outcome.warnings,
            parts_s=outcome.parts_s,
        )
