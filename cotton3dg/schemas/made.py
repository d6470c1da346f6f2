"""`.cotton3dg.made` of a folder that a person named: which files in it this tool made, and of what."""

from __future__ import annotations

from dataclasses import dataclass

from .document import WholeDocument


@dataclass(frozen=True)
class MadeFile:
    """One file."""

    made_of: str
    """Command and inputs."""
    sha256: str
    """As it was made; empty while it is being put there."""


@dataclass(frozen=True)
class MadeFiles(WholeDocument):
    """By path from the folder."""

    REMEDY = "remove it; the files in its folder then count as somebody else's"

    files: dict[str, MadeFile]
