# SPDX-License-Identifier: Apache-2.0
"""One file for the developers: what happened to a plant, and on what machine; images only on request."""

from __future__ import annotations

import os
import platform
import zipfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Final

from ..core.version import version_text
from ..errors import BadUsage
from ..outputs import made_of, saving
from ..stage import STAGES
from ..workspace import Workspace

PICTURES: Final = (".jpg", ".png", ".svg")


def pack(workspace: Workspace, out: Path, machine: str, *, images: bool = False) -> Path:
    """Write log, options, records, the small documents of the stages, and the versions of all libraries, as a zip.

    The user's home folder is `~` in every text.

    Args:
        machine: what `doctor` finds.
        images: also the frames and the pictures of the stages.
    Returns:
        `out`.
    Raises:
        BadUsage: `out` is not a .zip, or the folder holds nothing of a run.
    """
    if out.suffix != ".zip":
        raise BadUsage(f"--out {out}: give a name that ends in .zip")
    texts = list(_texts(workspace))
    if not texts:
        raise BadUsage("nothing was run here yet; run the command that fails, then report it")
    home = os.path.expanduser("~")  # noqa: PTH111 - which stays `~` where a user has no home
    with (
        saving(out.parent, made_of("bug-report", workspace.root)) as folder,
        zipfile.ZipFile(folder / out.name, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        archive.writestr("machine.txt", (_versions() + machine).replace(home, "~"))
        for path in texts:
            archive.writestr(
                _name(workspace, path), path.read_text(encoding="utf-8", errors="replace").replace(home, "~")
            )
        for path in _pictures(workspace) if images else ():
            archive.write(path, _name(workspace, path), zipfile.ZIP_STORED)
    return out


def _texts(workspace: Workspace) -> Iterator[Path]:
    wanted = [workspace.log_file, workspace.options_file, workspace.corrections_json, workspace.check_json]
    wanted += [workspace.record_file(stage) for stage in STAGES]
    for stage in STAGES:
        wanted += [path for ending in ("json", "csv") for path in sorted(workspace.folder(stage).glob(f"*.{ending}"))]
    return (path for path in wanted if path.is_file())


def _pictures(workspace: Workspace) -> Iterator[Path]:
    for stage in STAGES:
        yield from (path for path in sorted(workspace.folder(stage).glob("*")) if path.suffix in PICTURES)


def _name(workspace: Workspace, path: Path) -> str:
    return path.relative_to(workspace.root).as_posix()


def _versions() -> str:
    installed = {item.name: item.version for item in metadata.distributions()}
    lines = [f"cotton3dg {version_text()}", f"{platform.platform()}, Python {platform.python_version()}", ""]
    return "\n".join([*lines, *(f"{name}=={installed[name]}" for name in sorted(installed)), "", ""])
