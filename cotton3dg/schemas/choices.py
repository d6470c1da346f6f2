"""records/options.json: what was chosen of a plant's options."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .document import Document


@dataclass(frozen=True)
class Choices(Document):
    """How the last run of a plant was asked for. One that cannot be read is none: the records of the stages tell it."""

    REMEDY = "run `cotton3dg run` with the options that are to hold"

    preset: str = ""
    """Empty where none was named, or where a file names it."""
    values: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Stage -> option, as TOML would write it behind the stage -> value: what neither preset nor file gives."""
