# SPDX-License-Identifier: Apache-2.0
"""What this process has used of the machine: time of processors, and memory."""

from __future__ import annotations

import ctypes
import logging
import resource
from contextlib import suppress
from pathlib import Path

log = logging.getLogger("cotton3dg")


def cpu_seconds() -> float:
    """Seconds on all processors, with those of child processes that have ended."""
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def reset_peak_memory() -> None:
    """Return freed memory and reset the kernel's high-water mark, so that each stage has its own figure (Linux)."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)  # glibc's: a process that ran other stages or plants keeps hundreds of MiB
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        log.debug("the peak memory of single stages is not available here")


def peak_memory_mib() -> float:
    """High-water mark of resident memory since the last reset, or since the start if there is no reset."""
    try:
        status = Path("/proc/self/status").read_text()
        return round(int(status.split("VmHWM:")[1].split()[0]) / 1024, 1)
    except (OSError, IndexError, ValueError):
        return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1)
