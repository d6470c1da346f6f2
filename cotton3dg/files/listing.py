"""What a person put into a folder: neither hidden files nor those that macOS, Windows and file servers leave behind."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path
from typing import Final

LITTER: Final = frozenset(
    {
        "__macosx",  # of a ZIP file that macOS made; it holds a `._name` for each file
        "thumbs.db",
        "desktop.ini",
        "$recycle.bin",
        "system volume information",
        "@eadir",  # thumbnails of a Synology server, under the names of the photos
        "lost+found",
    }
)
"""Names in lower case."""


def is_litter(name: str) -> bool:
    """Whether a file or folder of this name is hidden, or made by a system for itself."""
    return name.startswith(".") or name.lower() in LITTER


def files_in(folder: Path, suffixes: Collection[str] = ()) -> list[Path]:
    """Files of a folder in order of name.

    Args:
        suffixes: in lower case, with the dot; the files may have them in capitals. None = all files.
    Raises:
        OSError: the folder cannot be read.
    """
    return sorted(path for path in folder.iterdir() if _is_wanted(path, suffixes))


def files_below(folder: Path, suffixes: Collection[str] = ()) -> list[Path]:
    """Files of a folder and of those below it at any depth, in order of path; links to folders are not followed."""
    found = []
    for parent, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not is_litter(name)]
        found += [path for name in names if _is_wanted(path := Path(parent, name), suffixes)]
    return sorted(found)


def folders_in(folder: Path) -> list[Path]:
    """Folders of a folder in order of name.

    Raises:
        OSError: the folder cannot be read.
    """
    return sorted(path for path in folder.iterdir() if not is_litter(path.name) and path.is_dir())


def _is_wanted(path: Path, suffixes: Collection[str]) -> bool:
    suits = not suffixes or path.suffix.lower() in suffixes
    return suits and not is_litter(path.name) and path.is_file()
