"""The part of the machine that this process may use."""

from __future__ import annotations

import os
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
