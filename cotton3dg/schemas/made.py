"""`.cotton3dg.made` of a folder that a person named: the files that this tool made in it, and their inputs."""

from __future__ import annotations

from dataclasses import dataclass

from .document import WholeDocument


@dataclass(frozen=True)
class MadeFile:
    """One file."""

    made_of: str
    """Command and inputs."""
    sha256: str
    """SHA-256 of the file as it was made; empty while the file is being written."""


@dataclass(frozen=True)
class MadeFiles(WholeDocument):
    """The made files, by path from the folder."""

    REMEDY = "remove it; the files in its folder then count as somebody else's"

    files: dict[str, MadeFile]
