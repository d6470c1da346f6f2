# SPDX-License-Identifier: Apache-2.0
"""The part of the machine that this process may use."""

from __future__ import annotations

import os
import resource
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def usable_cores() -> list[int]:
    """Numbers of the cores that a cluster's scheduler, a container or `batch` leaves to this process."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def confine(pid: int, cores: list[int], of: int) -> None:
    """Limit another process to these cores and to one share of the memory, if the system can (Linux).

    Args:
        of: number of equal shares.
    """
    if not hasattr(resource, "prlimit"):
        return
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // of
    try:
        os.sched_setaffinity(pid, cores)
        resource.prlimit(pid, resource.RLIMIT_DATA, (memory, memory))
    except ProcessLookupError:
        pass  # it has already ended, and its exit code says how


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Let OpenCV's functions use one thread each, because several are called at once."""
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def on_all_cores(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """The result for each item, in their order.

    It uses threads, for work of OpenCV, NumPy, Qhull and the project's own core, which release the interpreter lock.
    """
    with one_thread_each(), ThreadPoolExecutor(len(usable_cores())) as threads:
        return list(threads.map(function, items))


def stream_on_all_cores(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """As `on_all_cores`, for items too large to be held together: it holds one or two more items than cores."""
    cores = len(usable_cores())
    with one_thread_each(), ThreadPoolExecutor(cores) as threads:
        begun: deque[Future[Result]] = deque()
        for item in items:
            begun.append(threads.submit(function, item))
            if len(begun) > cores:
                yield begun.popleft().result()
        while begun:
            yield begun.popleft().result()
