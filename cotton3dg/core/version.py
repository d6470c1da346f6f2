# SPDX-License-Identifier: Apache-2.0
"""The version of this cotton3dg."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Final

from .. import __version__

PACKAGE: Final = Path(__file__).parents[1]


def version_text(package: Path = PACKAGE) -> str:
    """Version and, where it is known, the commit: a wheel has it in a file, a checkout gets it from git."""
    commit = _commit(package)
    return f"{__version__} (commit {commit})" if commit else __version__


def _commit(package: Path) -> str:
    if (named := package / "COMMIT").is_file():
        return named.read_text(encoding="utf-8").strip()
    if not (package.parent / ".git").exists():
        return ""
    try:
        described = subprocess.run(
            ["git", "-C", str(package.parent), "describe", "--always", "--dirty"],
            check=True,
            capture_output=True,
            text=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return ""
    return described.stdout.strip()
