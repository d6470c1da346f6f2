# SPDX-License-Identifier: Apache-2.0
"""Saving without loss: files change all at once and reach the disk, and errors of the disk are explained."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from ..errors import BadInput, Cotton3dgError, EnvironmentUnusable, OutOfResources

NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
NOT_ALLOWED: Final = (errno.EACCES, errno.EPERM, errno.EROFS)
WRONG_PATH: Final = (
    errno.ENOENT,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.EEXIST,
    errno.ENOTEMPTY,
    errno.ENAMETOOLONG,
    errno.ELOOP,
    errno.EINVAL,
)
"""Errors of the operating system about a path that is not what it should be."""
FULL_BELOW_BYTES: Final = 2**20
"""A disk with less free space is full: no stage can work with it."""
LACKS: Final = frozenset({errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EACCES, errno.EPERM})
"""Errors of file systems that do not support a request."""
LOST: Final = frozenset({errno.EIO, errno.ESTALE, errno.ENOTCONN, errno.ETIMEDOUT, errno.EHOSTDOWN, errno.ENODEV})
"""Errors of file systems when a disk fails or a network drive is gone."""
LONGEST_NAME_BYTES: Final = 255
"""Longest name of a file or folder on nearly all file systems."""
PART_BYTES: Final = 2**20
"""Length of the parts that are read at a file's beginning and at its end."""


@contextmanager
def explain_disk_errors(root: Path) -> Iterator[None]:
    """Turn the operating system's errors about full or read-only disks into ours, with a remedy."""
    try:
        yield
    except OSError as error:
        if error.errno in NO_ROOM:
            raise explained(error, root) from error
        if error.errno in NOT_ALLOWED:
            raise EnvironmentUnusable(
                f"no permission to write in {root}; change its permissions or copy the plant elsewhere"
            ) from error
        if error.errno in LOST:
            raise explained(error, root) from error
        raise


def explained(error: OSError, root: Path) -> Cotton3dgError:
    """What an error of the operating system means to a user who named paths.

    Args:
        root: the path in use, for an error that names no path.
    """
    place, why = error.filename or root, (error.strerror or str(error)).lower()
    if error.errno == errno.EFBIG:
        return OutOfResources(
            f"the disk that holds {root}, or a limit (`ulimit -f`), allows no larger files; use another one"
        )
    if error.errno in NO_ROOM:
        return full_disk(root)
    if error.errno in NOT_ALLOWED:
        return EnvironmentUnusable(f"no permission for {place}; change its permissions, or give another path")
    if error.errno in WRONG_PATH:
        return BadInput(f"{place}: {why}; look at its spelling, or give another path")
    return EnvironmentUnusable(f"{place}: {why}; look at the disk that holds it, and run again")


def full_disk(root: Path) -> OutOfResources:
    return OutOfResources(f"the disk that holds {root} is full; free some space and run again")


def write_text_atomically(path: Path, text: str) -> None:
    """Replace `path` so that a reader or a crash sees the old text or the new one, never a part."""
    with replacing(path) as partial:
        # A name of a file or folder that is not UTF-8 is written as it is printed.
        partial.write_text(text, encoding="utf-8", errors="backslashreplace")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to that becomes `path`, all at once, when the block ends without an error."""
    partial = path.with_name(partial_name(path.name))
    path.parent.mkdir(exist_ok=True)
    try:
        yield partial
        fsync(partial)
        partial.replace(path)
        fsync(path.parent)
    finally:
        partial.unlink(missing_ok=True)


def partial_name(name: str) -> str:
    """The name of a file or folder until it is whole; not longer than a name may be."""
    room = LONGEST_NAME_BYTES - len("..partial")
    return f".{os.fsencode(name)[:room].decode(errors='ignore')}.partial"


def printable(name: str) -> str:
    """A name in which bytes that are not UTF-8 are written as `\\udcfc`."""
    return name.encode("utf-8", "backslashreplace").decode()


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
    """Write a file or a folder to the disk now, if its file system supports that.

    Raises:
        OSError: the disk is full or fails.
    """
    try:
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    except OSError as error:
        if error.errno not in LACKS:
            raise


def link(source: Path, target: Path) -> None:
    """Make `target` the same as a file or folder with hard links, or with copies where links are not possible.

    Links to folders within a folder are not followed, and what is neither file nor folder is left out.
    """
    if source.is_dir():
        target.mkdir(exist_ok=True)
        for path in source.iterdir():
            if path.is_file() or (path.is_dir() and not path.is_symlink()):
                link(path, target / path.name)
        return
    try:
        os.link(source.resolve(), target)
    except OSError:
        copy(source, target)


def copy(source: Path, target: Path) -> None:
    """Copy a file, and its dates and permissions where the file system has them."""
    shutil.copyfile(source, target)
    with suppress(OSError):
        shutil.copystat(source, target)
