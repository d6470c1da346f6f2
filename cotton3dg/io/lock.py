# SPDX-License-Identifier: Apache-2.0
"""A lock on a file that ends with the process that holds it, however the process dies.

Some network drives and shared folders of virtual machines have no locks. There a file with the name of the host and the
number of the process stands beside the lock for as long as the process works.
"""

from __future__ import annotations

import errno
import fcntl
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from ..errors import EnvironmentUnusable
from .saving import explain_disk_errors

LOOKS_EVERY_S: Final = 1.0
"""How often a waiting process looks for the files of others, where there are no locks."""
KERNEL: Final = Path("/proc/locks")
"""The locks of this machine, on Linux, each with the number of its file."""


@contextmanager
def locked(path: Path, *, wait: bool = False) -> Iterator[None]:
    """Lock a file for this process; create it if needed.

    Args:
        wait: wait until the holder ends instead of failing.
    Raises:
        EnvironmentUnusable: another process holds the lock; the message names it.
    """
    with explain_disk_errors(path.parent):
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    own = None
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EACCES):
                raise _held(_holder(handle)) from error
            with explain_disk_errors(path.parent):  # this file system has no locks
                own = _register(path, wait)
        _sign(handle)
        yield
    finally:
        os.close(handle)
        if own:
            own.unlink(missing_ok=True)


def is_held(path: Path) -> bool:
    """Whether a process works under a lock. Looking does not take it: a run that starts meanwhile has to get it."""
    try:
        number, signed = path.stat().st_ino, path.read_text("utf-8", "replace")
    except OSError:
        return False
    if _others(path, path):
        return True
    with suppress(OSError):
        return f":{number} " in KERNEL.read_text("utf-8")
    word, _, host = signed.removeprefix("process ").partition(" on ")
    return host == platform.node() and word.isdecimal() and _is_alive(int(word))


def _held(by: str, remedy: str = "") -> EnvironmentUnusable:
    return EnvironmentUnusable(
        f"another cotton3dg{by} is working in this folder; wait for it (`cotton3dg run --wait`), or stop it{remedy}"
    )


def _sign(handle: int) -> None:
    """Write the holder into the file; the lock does not depend on it."""
    with suppress(OSError):
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"process {os.getpid()} on {platform.node()}".encode(), 0)


def _holder(handle: int) -> str:
    """The holder from the file, as ` (process 17 on this-machine)`; empty if it cannot be read."""
    with suppress(OSError):
        signed = os.pread(handle, 256, 0).decode("utf-8", "replace").strip()
        return f" ({signed})" if signed else ""
    return ""


def _register(path: Path, wait: bool) -> Path:
    """Create this process's file, unless another process has one; return its path.

    Each process creates its own file before it looks for others. If two come at once, one or both give up: the two
    never hold the lock together.
    """
    own = path.with_name(f"{path.name}.{os.getpid()}.{platform.node()}")
    while True:
        own.touch()
        others = _others(path, own)
        if not others:
            return own
        own.unlink()
        if not wait:
            number, host = _parts(path, others[0])
            raise _held(f" (process {number} on {host})", f"; if it has ended, delete {others[0].name}")
        time.sleep(LOOKS_EVERY_S * (1 + os.getpid() % 100 / 100))  # waiting processes look at different moments


def _others(path: Path, own: Path) -> list[Path]:
    """Files of other processes, without those of this host that have ended, which are removed."""
    others = []
    for other in sorted(path.parent.glob(f"{path.name}.*")):
        number, host = _parts(path, other)
        if other == own or not number.isdecimal():
            continue
        if host == platform.node() and not _is_alive(int(number)):
            other.unlink(missing_ok=True)
        else:
            others.append(other)
    return others


def _parts(path: Path, other: Path) -> tuple[str, str]:
    """Number of the process and host, from the name of a process's file."""
    number, _, host = other.name.removeprefix(f"{path.name}.").partition(".")
    return number, host


def _is_alive(process: int) -> bool:
    with suppress(PermissionError):  # it is another user's
        try:
            os.kill(process, 0)
        except (ProcessLookupError, OverflowError):
            return False
    return True
