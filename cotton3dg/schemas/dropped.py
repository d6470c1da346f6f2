"""records/dropped.json: files that `cotton3dg clean` dropped."""

from __future__ import annotations

from dataclasses import dataclass

from .document import WholeDocument


@dataclass(frozen=True)
class DroppedFiles(WholeDocument):
    """Files dropped since the plant's stages last wrote. An unreadable file counts as missing; the stages run again."""

    REMEDY = "run `cotton3dg run`, which makes the files again"

    names: tuple[str, ...]
    """Paths from the plant's folder."""
