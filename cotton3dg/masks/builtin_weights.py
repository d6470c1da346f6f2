"""Weights that come with the program: FILE, and what it must add up to in FILE.sha256 beside it."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

from ..errors import EnvironmentUnusable

REINSTALL: Final = "install cotton3dg again"


def read_shipped(file: Path) -> bytes:
    """The content of a file that the program brings.

    Raises:
        EnvironmentUnusable: the file is gone, or has changed.
    """
    try:
        content = file.read_bytes()
        wanted = file.with_name(f"{file.name}.sha256").read_text(encoding="ascii").split()[0]
    except FileNotFoundError as error:
        raise EnvironmentUnusable(f"{error.filename}, which comes with cotton3dg, is not there; {REINSTALL}") from error
    if hashlib.sha256(content).hexdigest() != wanted:
        raise EnvironmentUnusable(f"{file}, which comes with cotton3dg, is damaged; {REINSTALL}")
    return content
