# SPDX-License-Identifier: Apache-2.0
"""The files that a person put into a folder, without hidden ones and those that macOS, Windows and servers leave."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from ..errors import BadInput
from .saving import explained, printable

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
    """Whether a file or folder of this name is hidden, or made by an operating system or server for itself."""
    return name.startswith(".") or name.lower() in LITTER


def files_in(folder: Path, suffixes: Collection[str] = ()) -> list[Path]:
    """Files of a folder in order of name.

    Args:
        suffixes: in lower case, with the dot; the files may have them in capitals. None = all files.
    Raises:
        EnvironmentUnusable: the folder cannot be read. BadInput: a name is not UTF-8.
    """
    with _explained(folder):
        return sorted(require_utf8(path) for path in folder.iterdir() if _is_wanted(path, suffixes))


def files_below(
    folder: Path, suffixes: Collection[str] = (), refused: Callable[[OSError], None] | None = None
) -> list[Path]:
    """Files of a folder and of those below it at any depth, in order of path; links to folders are not followed.

    Args:
        refused: called for each folder that cannot be read, with the error that names it.
    """
    found = []
    for parent, folders, names in os.walk(folder, onerror=refused):
        folders[:] = [name for name in folders if not is_litter(name)]
        found += [path for name in names if _is_wanted(path := Path(parent, name), suffixes)]
    return sorted(found)


def folders_in(folder: Path) -> list[Path]:
    """Folders of a folder in order of name.

    Raises:
        EnvironmentUnusable: the folder cannot be read.
    """
    with _explained(folder):
        return sorted(path for path in folder.iterdir() if not is_litter(path.name) and path.is_dir())


def is_there(path: Path) -> bool:
    """Whether a file or folder can be seen; one in a folder that may not be entered cannot."""
    with suppress(OSError):
        return path.exists()
    return False


def require_utf8(path: Path) -> Path:
    """The path, if all programs and file formats can name it.

    Raises:
        BadInput: a name in it is not UTF-8, as on a drive or in an archive from a computer with another code page.
    """
    if printable(str(path)) != str(path):
        raise BadInput(f"the name {printable(path.name)} is not UTF-8; rename it, with letters from a to z")
    return path


@contextmanager
def _explained(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise explained(error, folder) from error


def _is_wanted(path: Path, suffixes: Collection[str]) -> bool:
    suits = not suffixes or path.suffix.lower() in suffixes
    return suits and not is_litter(path.name) and path.is_file()
