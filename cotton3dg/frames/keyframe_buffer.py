# SPDX-License-Identifier: Apache-2.0
"""The best frames of a film so far, held while it streams by, in bounded space.

The length of the way is not known beforehand. At first every frame is held. When the room is full, the way so far is
divided into intervals, so many that a third of the room becomes free, and each keeps its best frame. From then on
intervals become longer by half each time the room is full.
"""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

WIDER: Final = 1.5


class HeldFrames:
    """Frames by number, in a file without a name that the system may keep in memory as long as it likes."""

    def __init__(self, room: int, size: int, kind: Any, folder: Path):
        """
        Args:
            room: largest number of held frames.
            size: numbers a frame, of the dtype `kind`.
            folder: on the disk that has the space.
        """
        with TemporaryFile(dir=folder) as file:
            # Taken at once: writing to a mapped file that finds the disk full would end the process without a word.
            if hasattr(os, "posix_fallocate"):  # macOS has none
                os.posix_fallocate(file.fileno(), 0, room * size * np.dtype(kind).itemsize)
            self._slots = np.memmap(file, kind, "w+", shape=(room, size))
        self._free = list(range(room - 1, -1, -1))
        self._interval = 0.0
        self._held: dict[int, tuple[int, int, float, float]] = {}
        """Interval -> slot, frame, way and score."""

    def __contains__(self, frame: int) -> bool:
        return any(frame == other for _, other, _, _ in self._held.values())

    @property
    def frames(self) -> list[int]:
        """Numbers, ascending."""
        return sorted(frame for _, frame, _, _ in self._held.values())

    def numbers_of(self, frame: int) -> NDArray[Any]:
        """(size,) of a held frame."""
        return next(self._slots[slot] for slot, other, _, _ in self._held.values() if other == frame)

    def offer(self, frame: int, way: float, score: float, numbers: NDArray[Any]) -> None:
        """Hold a frame if it is the best of its interval of the way.

        Args:
            frame, way: not less than those before.
            score: higher is better.
            numbers: (size,) copied if the frame is held.
        """
        place = self._place(frame, way)
        known = self._held.get(place)
        if known and known[3] >= score:
            return
        if known is None and not self._free:
            self._widen(way)
            self.offer(frame, way, score, numbers)
            return
        slot = known[0] if known else self._free.pop()
        self._slots[slot] = numbers
        self._held[place] = (slot, frame, way, score)

    def _place(self, frame: int, way: float) -> int:
        return int(way / self._interval) if self._interval else frame

    def _widen(self, way: float) -> None:
        """Make intervals longer, so that at most two thirds of the room are taken."""
        start = WIDER * max(way, 1e-9) / len(self._slots)
        self._interval = max(WIDER * self._interval, start) * (1 + 1e-9)
        best: dict[int, tuple[int, int, float, float]] = {}
        for held in sorted(self._held.values(), key=lambda held: (-held[3], held[1])):
            place = self._place(held[1], held[2])
            if place in best:
                self._free.append(held[0])
            else:
                best[place] = held
        self._held = best


def select_keyframes(ways: NDArray[np.float64], scores: NDArray[np.float64], count: int) -> list[int]:
    """Indices of at most `count` of n frames at even steps of the way, the better ones preferred; ascending.

    Frames are left out one by one: each time the one with the smallest gap between its neighbours before and behind.
    The gap of a frame with half the score of its better neighbour counts as half as long.

    Args:
        ways: (n,) ascending.
        scores: (n,) at least 0, higher is better.
    """
    kept = np.arange(len(ways))
    while len(kept) > max(count, 2):
        near = np.stack([scores[kept[:-2]], scores[kept[1:-1]], scores[kept[2:]]])
        worth = near[1] / np.maximum(near.max(axis=0), 1e-12)
        gaps = (ways[kept[2:]] - ways[kept[:-2]]) * worth
        kept = np.delete(kept, 1 + int(np.argmin(gaps)))
    chosen: list[int] = kept[:count].tolist()
    return chosen
