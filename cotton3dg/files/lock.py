"""A lock on a file that ends with the process that holds it, however that dies."""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import EnvironmentUnusable
from .saving import explain_disk_errors


@contextmanager
def locked(path: Path, *, wait: bool = False) -> Iterator[None]:
    """Hold a file, made if needed, for this process.

    Args:
        wait: until whoever holds it ends, instead of failing.
    Raises:
        EnvironmentUnusable: another process holds it.
    """
    with explain_disk_errors(path.parent):
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EACCES):
                raise
            raise EnvironmentUnusable("another cotton3dg is working in this folder; wait for it or stop it") from error
        yield
    finally:
        os.close(handle)
