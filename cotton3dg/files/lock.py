"""A lock on a file that ends with the process that holds it, however that dies."""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import EnvironmentUnusable
from .saving import explain_disk_errors


@contextmanager
def locked(path: Path, *, wait: bool = False) -> Iterator[None]:
    """Hold a file, made if needed, for this process.

    Args:
        wait: until whoever holds it ends, instead of failing.
    Raises:
        EnvironmentUnusable: another process holds it, which the message names.
    """
    with explain_disk_errors(path.parent):
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EACCES):
                raise
            raise EnvironmentUnusable(
                f"another cotton3dg{_holder(handle)} is working in this folder; wait for it (`cotton3dg run --wait`),"
                " or stop it"
            ) from error
        _sign(handle)
        yield
    finally:
        os.close(handle)


def _sign(handle: int) -> None:
    """Leave in the file who holds it; the lock does not depend on it."""
    with suppress(OSError):
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"process {os.getpid()} on {os.uname().nodename}".encode(), 0)


def _holder(handle: int) -> str:
    """What its holder left there, as ` (process 17 on this-machine)`; nothing where that cannot be read."""
    with suppress(OSError):
        signed = os.pread(handle, 256, 0).decode("utf-8", "replace").strip()
        return f" ({signed})" if signed else ""
    return ""
