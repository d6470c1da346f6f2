# SPDX-License-Identifier: Apache-2.0
"""Files that a command saves in a folder of the user's choice.

A command may replace files that it made before from the same inputs. Files from other inputs, files that were changed
since, and files from somebody else stay: the command says so and writes nothing.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from .errors import BadUsage
from .io.saving import explain_disk_errors, file_sha256
from .options import STAGE_OPTIONS
from .schemas.document import WholeDocument
from .workspace import OWNER_MARK

LIST: Final = ".cotton3dg.made"
PARTIAL: Final = ".cotton3dg.partial"


@dataclass(frozen=True)
class MadeFile:
    """One file."""

    made_of: str
    """Command and inputs."""
    sha256: str
    """SHA-256 of the file as it was made; empty while the file is being written."""


@dataclass(frozen=True)
class MadeFiles(WholeDocument):
    """`.cotton3dg.made` of a folder that a person named: the files that this tool made in it, by path from there."""

    REMEDY = "remove it; the files in its folder then count as somebody else's"

    files: dict[str, MadeFile]


def made_of(command: str, *inputs: Path | str) -> str:
    """The origin of outputs: a command and its inputs; paths become absolute."""
    return " ".join([command, *(str(each.resolve() if isinstance(each, Path) else each) for each in inputs)])


@contextmanager
def saving(folder: Path, made_of: str, *, instead: str = "--out") -> Iterator[Path]:
    """A private folder whose files go to `folder`, made if needed, when the block ends without an error.

    Args:
        instead: the option to save elsewhere, for messages.
    Raises:
        BadUsage: a file with one of their names exists and must stay, or `folder` is not for outputs.
    """
    if folder.exists() and not folder.is_dir():
        raise BadUsage(f"{folder} is a file where a folder is due; give another {instead}")
    if folder.name in STAGE_OPTIONS and (folder / OWNER_MARK).exists():
        raise BadUsage(f"{folder} is a plant's own folder; give another {instead}")
    is_new = not folder.is_dir()
    with explain_disk_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        partial = folder / PARTIAL
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        try:
            yield partial
            _put(partial, folder, made_of, instead)
            if is_new:
                (folder / OWNER_MARK).touch()  # so that `batch` does not take it for a plant
        finally:
            shutil.rmtree(partial, ignore_errors=True)
            if is_new and not any(folder.iterdir()):
                folder.rmdir()


def _put(partial: Path, folder: Path, made_of: str, instead: str) -> None:
    known = MadeFiles.load_if_there(folder / LIST)
    made = {path.name: MadeFile(made_of, file_sha256(path)) for path in sorted(partial.iterdir())}
    for name in made:
        # An earlier version made a folder of this tool that has no list yet.
        if (folder / name).exists() and not (known is None and (folder / OWNER_MARK).exists()):
            _refuse(folder / name, known.files.get(name) if known else None, made_of, instead)
    before = known.files if known else {}
    # If the process is killed while it moves the files, the same command may replace them.
    MadeFiles(before | {name: MadeFile(made_of, "") for name in made}).save(folder / LIST)
    for name in made:
        (partial / name).replace(folder / name)
    MadeFiles(before | made).save(folder / LIST)


def _refuse(path: Path, entry: MadeFile | None, made_of: str, instead: str) -> None:
    remedy = f"move it elsewhere or give another {instead}"
    if entry is None:
        raise BadUsage(f"{path} is there and was not made by this command; {remedy}")
    if entry.made_of != made_of:
        raise BadUsage(f"{path} is there and was made by `cotton3dg {entry.made_of}`; {remedy}")
    if entry.sha256 not in ("", file_sha256(path)):
        raise BadUsage(f"{path} was changed since it was made; {remedy}")


def note_all(folder: Path, made_of: str) -> None:
    """Record all files below a folder as they are."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    entries = {path.relative_to(folder).as_posix(): MadeFile(made_of, file_sha256(path)) for path in files}
    MadeFiles(entries).save(folder / LIST)


def refuse_changed(folder: Path) -> None:
    """Refuse to replace a folder in which a person has worked since.

    Raises:
        BadUsage: a file was changed or added; the message names it.
    """
    if not folder.is_dir():
        return
    known = MadeFiles.load_if_there(folder / LIST) or MadeFiles({})
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")):
        name = path.relative_to(folder).as_posix()
        if name not in known.files or known.files[name].sha256 != file_sha256(path):
            raise BadUsage(f"{folder.name}/{name} was changed or added by hand; move {folder.name} elsewhere first")
