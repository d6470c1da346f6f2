"""records/options.json: the options that were chosen for a plant."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .document import Document


@dataclass(frozen=True)
class Choices(Document):
    """The options of a plant's last run. An unreadable file counts as missing; the stages' records have the options."""

    REMEDY = "run `cotton3dg run` with the options that are to hold"

    preset: str = ""
    """Empty if no preset was named, or if a file names it."""
    values: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Stage -> option, as TOML would write it behind the stage -> value, for options from neither preset nor file."""
