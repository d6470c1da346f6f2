"""Saving without loss: all at once, on the disk for certain, with the disk's errors explained."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from ..errors import EnvironmentUnusable, OutOfResources

FULL_BELOW_BYTES: Final = 2**20
"""No stage can work with less."""
PART_BYTES: Final = 2**20
"""Of a file's beginning and of its end."""


@contextmanager
def explain_disk_errors(root: Path) -> Iterator[None]:
    """Turn the operating system's errors about full or read-only disks into ours, with a remedy."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise full_disk(root) from error
        if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise EnvironmentUnusable(
                f"no permission to write in {root}; change its permissions or copy the plant elsewhere"
            ) from error
        raise


def full_disk(root: Path) -> OutOfResources:
    return OutOfResources(f"the disk that holds {root} is full; free some space and run again")


def write_text_atomically(path: Path, text: str) -> None:
    """Replace `path` so that a reader or a crash sees the old text or the new one, never a part."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to that becomes `path`, all at once, when the block ends without an error."""
    partial = path.with_name(f".{path.name}.partial")
    path.parent.mkdir(exist_ok=True)
    try:
        yield partial
        fsync(partial)
        partial.replace(path)
        fsync(path.parent)
    finally:
        partial.unlink(missing_ok=True)


def json_text(value: Any) -> str:
    """JSON as this tool writes it: sorted, indented, without NaN (null instead)."""
    return json.dumps(_finite(value), indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if hasattr(value, "tolist"):
        return _finite(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def file_sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def fingerprint(path: Path) -> str:
    """Hash of size, beginning and end of a file: reading fifty whole videos would take as long as copying them."""
    size = path.stat().st_size
    with path.open("rb") as file:
        found = hashlib.sha256(f"{size} ".encode() + file.read(PART_BYTES))
        file.seek(max(0, size - PART_BYTES))
        found.update(file.read(PART_BYTES))
    return found.hexdigest()


def fsync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def link(source: Path, target: Path) -> None:
    """Make `target` the same as a file or folder by hard links, or by copies where there are none."""
    if source.is_dir():
        shutil.copytree(source, target, copy_function=_link_file, dirs_exist_ok=True)
    else:
        _link_file(source, target)


def _link_file(source: Path | str, target: Path | str) -> None:
    try:
        os.link(Path(source).resolve(), target)
    except OSError:
        shutil.copy2(source, target)
