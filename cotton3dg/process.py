# SPDX-License-Identifier: Apache-2.0
"""The process of the command line: signals that end it, and streams that are closed, full or short of letters."""

from __future__ import annotations

import io
import logging
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, Final, TextIO

from .errors import HUNG_UP, TERMINATED, UNREAD
from .io.saving import explained

ENDING: Final = {signal.SIGTERM: TERMINATED, signal.SIGHUP: HUNG_UP}
"""Signals that end a command as Ctrl-C does, which is Python's KeyboardInterrupt, and their exit codes."""


@contextmanager
def exit_cleanly() -> Iterator[None]:
    """Let the command inside end with an exit code of its own and at most one line, whatever happens to its process.

    A signal ends it as Ctrl-C does: its child processes end too, and the same command can continue in its folder.
    Unwritable messages are left out. If results cannot be printed, the command ends once its files are saved.
    """
    for number in ENDING:
        if signal.getsignal(number) == signal.SIG_DFL:  # nohup makes processes ignore it
            signal.signal(number, _end)
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it warns if the home has no place for its cache
    sys.stderr = _reopened(sys.stderr, _Messages)
    sys.stdout = _reopened(sys.stdout, _Results)
    try:
        yield
    finally:
        if sys.stdout:
            sys.stdout.flush()


def _end(number: int, frame: FrameType | None) -> None:
    for other in ENDING:
        signal.signal(other, signal.SIG_IGN)  # during the clean-up
    with suppress(OSError):
        os.write(2, f"ended by {signal.Signals(number).name}; the same command continues\n".encode())
    raise SystemExit(ENDING[signal.Signals(number)])


class _Messages(io.FileIO):
    """A stream that stays silent after a failure: work goes on even if nobody can read its messages."""

    _lost = False

    def write(self, content: Any) -> int:
        if not self._lost:
            try:
                return super().write(content)
            except OSError as error:
                self._lost = True
                self._give_up(error)
        return len(content)

    def _give_up(self, error: OSError) -> None:
        """React to the first failure."""


class _Results(_Messages):
    """A stream whose failure ends the command."""

    def _give_up(self, error: OSError) -> None:
        if isinstance(error, BrokenPipeError):  # `| head` has read enough
            raise SystemExit(UNREAD)
        explanation = explained(error, Path("standard output"))
        print(f"{explanation} (what was saved is whole)", file=sys.stderr)
        raise SystemExit(explanation.exit_code)


def _reopened(stream: TextIO, kind: type[_Messages]) -> TextIO:
    """The same stream as a `kind`; letters that it does not have become `\\xe9`. None stays None."""
    try:
        raw = kind(stream.fileno(), "w", closefd=False)
    except (AttributeError, OSError, ValueError):  # closed, or not a file
        return stream
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors="backslashreplace",
        line_buffering=bool(stream.line_buffering),
        write_through=kind is _Messages,
    )
