# SPDX-License-Identifier: Apache-2.0
"""records/ of a plant: what each stage's run did, the options that were chosen, and the files that `clean` dropped."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Final

from ..core.runs import StageOutcome
from .document import Document, WholeDocument

OK: Final = "ok"
FAILED: Final = "failed"


@dataclass(frozen=True)
class Record(Document):
    """records/<stage>.json: the last run of a stage. An unreadable one counts as missing, and its stage as stale."""

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


@dataclass(frozen=True)
class Choices(Document):
    """records/options.json: the options of a plant's last run.

    An unreadable file counts as missing; the stages' records have the options.
    """

    REMEDY = "run `cotton3dg run` with the options that are to hold"

    preset: str = ""
    """Empty if no preset was named, or if a file names it."""
    values: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Stage -> option, as TOML would write it behind the stage -> value, for options from neither preset nor file."""


@dataclass(frozen=True)
class DroppedFiles(WholeDocument):
    """records/dropped.json: files that `cotton3dg clean` dropped since the plant's stages last wrote.

    An unreadable file counts as missing; the stages run again.
    """

    REMEDY = "run `cotton3dg run`, which makes the files again"

    names: tuple[str, ...]
    """Paths from the plant's folder."""
