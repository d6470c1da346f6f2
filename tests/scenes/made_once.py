# SPDX-License-Identifier: Apache-2.0
"""Folders that take long to make: made once, also where several processes test."""

import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest


def made_once(temporary: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """The folder `name` as `make` leaves it; the first process that asks makes it, the others wait for it.

    Args:
        temporary: of the session. The processes of pytest-xdist have a folder each below one of the whole session.
        make: fills a folder that is there and empty.
    """
    common = temporary.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        common = common.parent
    folder, done = common / name, common / f"{name}.done"
    with (common / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not done.exists():
            shutil.rmtree(folder, ignore_errors=True)  # what a process that failed has left
            folder.mkdir()
            make(folder)
            done.touch()
    return folder
