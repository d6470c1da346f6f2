# SPDX-License-Identifier: Apache-2.0
"""Memory and disk that stages need: checks before they start if possible, and clear errors if they run out."""

from __future__ import annotations

import errno
import re
import resource
import shutil
from typing import Any, Final

from .errors import OutOfResources
from .stage import stage_of
from .workspace import Workspace

MIB: Final = 2**20
SPARE_MIB: Final = 16
"""Disk for records, the log and the small tables."""
LEAST_MEMORY_MIB: Final = {resource.RLIMIT_AS: 2000, resource.RLIMIT_DATA: 1000}
"""Address space and data that the libraries take with a small plant. Below it some of them end the process without an
exception."""
OUT_OF_MEMORY: Final = re.compile(
    r"allocate memory|out of memory|bad.?alloc|insufficient memory|failed to map segment|can't start new thread|"
    r"Resource temporarily unavailable",
    re.IGNORECASE,
)
"""Messages of libraries that have no error class of their own for it."""


def check_disk(workspace: Workspace, stage: str, options: Any) -> None:
    """Refuse to start a stage for which the disk has no room; the old result stays until the new one is whole.

    Raises:
        OutOfResources: the message gives the needed and the free space.
    """
    needed_mib, free_mib = needed_disk_mib(workspace, stage, options), shutil.disk_usage(workspace.root).free / MIB
    if free_mib < needed_mib:
        raise OutOfResources(
            f"{stage} needs about {needed_mib:.0f} MiB of disk and {free_mib:.0f} MiB are free; free some space"
            " (`cotton3dg clean` drops what can be made again of finished plants)"
        )


def check_memory() -> None:
    """Refuse to start if a limit (ulimit -v, ulimit -d, a scheduler) leaves too little memory for any stage.

    Raises:
        OutOfResources: the message gives the needed and the allowed memory.
    """
    for kind, needed_mib in LEAST_MEMORY_MIB.items():
        allowed = resource.getrlimit(kind)[0]
        if allowed != resource.RLIM_INFINITY and allowed < needed_mib * MIB:
            raise OutOfResources(
                f"a limit allows {allowed / MIB:.0f} MiB of memory and {needed_mib} MiB are needed at least; raise it"
                " (ulimit -v, ulimit -d, or what the scheduler was asked for)"
            )


def needed_disk_mib(workspace: Workspace, stage: str, options: Any) -> float:
    """Generous estimate of what a stage writes."""
    return SPARE_MIB + stage_of(stage).disk_bytes(workspace, options) / MIB


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an error, or one of its causes, means that memory has run out, in any library."""
    cause = error.__cause__ or error.__context__
    return (
        isinstance(error, MemoryError)
        or (isinstance(error, OSError) and error.errno == errno.ENOMEM)
        or OUT_OF_MEMORY.search(str(error)) is not None
        or (cause is not None and is_out_of_memory(cause))
    )
