"""Files that a command saves where a person says.

What a command made before of the same may be made again. What it made of something else, what was changed since, and
what somebody else made stays: the command says so and writes nothing.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from .errors import BadUsage
from .io.saving import explain_disk_errors, file_sha256
from .options import STAGE_OPTIONS
from .schemas.made import MadeFile, MadeFiles
from .workspace import OWNER_MARK

LIST: Final = ".cotton3dg.made"
PARTIAL: Final = ".cotton3dg.partial"


def made_of(command: str, *inputs: Path | str) -> str:
    """What tells outputs apart: a command and what it read; paths are made absolute."""
    return " ".join([command, *(str(each.resolve() if isinstance(each, Path) else each) for each in inputs)])


@contextmanager
def saving(folder: Path, made_of: str, *, instead: str = "--out") -> Iterator[Path]:
    """A private folder whose files go to `folder`, made if needed, when the block ends without an error.

    Args:
        instead: what a person gives to save elsewhere, for messages.
    Raises:
        BadUsage: a file of one of their names is there and is not to be replaced, or `folder` is not for outputs.
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
                (folder / OWNER_MARK).touch()  # so that `batch` takes it for no plant
        finally:
            shutil.rmtree(partial, ignore_errors=True)
            if is_new and not any(folder.iterdir()):
                folder.rmdir()


def _put(partial: Path, folder: Path, made_of: str, instead: str) -> None:
    known = MadeFiles.load_if_there(folder / LIST)
    made = {path.name: MadeFile(made_of, file_sha256(path)) for path in sorted(partial.iterdir())}
    for name in made:
        # A folder of this tool's that has no list yet was made by an earlier version.
        if (folder / name).exists() and not (known is None and (folder / OWNER_MARK).exists()):
            _refuse(folder / name, known.files.get(name) if known else None, made_of, instead)
    before = known.files if known else {}
    # Killed while it puts them there, it may put them there again.
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
    """Remember all files below a folder as they are."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    entries = {path.relative_to(folder).as_posix(): MadeFile(made_of, file_sha256(path)) for path in files}
    MadeFiles(entries).save(folder / LIST)


def refuse_changed(folder: Path) -> None:
    """Refuse to make a folder again that a person has worked in since.

    Raises:
        BadUsage: names a file that was changed or added.
    """
    if not folder.is_dir():
        return
    known = MadeFiles.load_if_there(folder / LIST) or MadeFiles({})
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")):
        name = path.relative_to(folder).as_posix()
        if name not in known.files or known.files[name].sha256 != file_sha256(path):
            raise BadUsage(f"{folder.name}/{name} was changed or added by hand; move {folder.name} elsewhere first")
