# SPDX-License-Identifier: Apache-2.0
"""Checks and measurements that a page asks for, one after the other, each in a process of its own."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from queue import SimpleQueue
from typing import Final

from ..errors import DOUBTFUL, BadUsage, CaptureFailed

DONE_WITH: Final = {"check": (0, DOUBTFUL, CaptureFailed.exit_code), "run": (0,)}
"""Command -> exit codes with which it has done its work."""
BUTTONS: Final = {"check": "Check the film", "run": "Measure"}
"""Command -> the words of its button."""
WAITS: Final = "waits for its turn"
STOPPED: Final = {name: f"stopped; “{button}” goes on from there" for name, button in BUTTONS.items()}
FAR: Final = re.compile(r"(\w+)(?: \(\d+ of \d+\))?: (\d+)/([1-9]\d*)\b.*?(, about [^,]+ left)?$")
"""A line of a command that says how far it is. Its place among the stages counts only those that this command runs."""


def how_far(line: str) -> str:
    """`train, 47 %, about 40 s left` for a line of a command; empty if it does not say."""
    if not (far := FAR.match(line)):
        return ""
    name, done, total, left = far.groups("")
    return f"{name}, {min(99, 100 * int(done) // int(total))} %{left}"


class CommandQueue:
    """Checks and measurements of plants, one after the other, each a command in a process of its own."""

    def __init__(self) -> None:
        self.asked: set[str] = set()
        """Plants that are at work or wait."""
        self._lines: dict[str, str] = {}
        """Plant -> the last line of its work, or why it came to nothing."""
        self._stopped: set[str] = set()
        self._queue: SimpleQueue[tuple[str, list[str]]] = SimpleQueue()
        self._process: subprocess.Popen[str] | None = None
        self._works_on = ""
        self._ended = threading.Event()
        threading.Thread(target=self._work, daemon=True).start()

    def add(self, plant: str, words: list[str]) -> None:
        """Put a command with its arguments behind the others.

        Raises:
            BadUsage: the plant waits already.
        """
        if plant in self.asked:
            raise BadUsage(f"{plant} is at work or waits already")
        self.asked.add(plant)
        self._lines[plant] = WAITS
        self._queue.put((plant, words))

    def text(self, plant: str) -> str:
        """How far the work on a plant is, or why it came to nothing; may be empty."""
        if plant in self._stopped:
            return "stops"
        line = self._lines.get(plant, "")
        return line if plant not in self.asked or line == WAITS else how_far(line)

    def stop(self, plant: str) -> None:
        """End the work on a plant, or let it not begin; the same command continues from there."""
        if plant in self.asked:
            self._stopped.add(plant)
            if self._works_on == plant and self._process:
                self._process.terminate()

    def close(self) -> None:
        """End the command that works; the same command continues from there."""
        self._ended.set()
        if process := self._process:
            process.terminate()
            process.wait()

    def _work(self) -> None:
        while True:
            plant, words = self._queue.get()
            if self._ended.is_set():
                return
            self._works_on, self._lines[plant] = plant, ""
            done = plant not in self._stopped and self._run(plant, words) in DONE_WITH[words[0]]
            if done:
                del self._lines[plant]
            elif plant in self._stopped:
                self._lines[plant] = STOPPED[words[0]]
            self._works_on = ""
            self._stopped.discard(plant)
            self.asked.discard(plant)

    def _run(self, plant: str, words: list[str]) -> int:
        # A session of its own keeps the terminal's Ctrl-C away from the process; `close` ends it.
        with subprocess.Popen(
            [sys.executable, "-m", "cotton3dg.cli", *words],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,
        ) as self._process:
            if plant in self._stopped:  # while it began
                self._process.terminate()
            for line in self._process.stderr or ():
                if line.strip():
                    self._lines[plant] = line.strip()
        return self._process.returncode
