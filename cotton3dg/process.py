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
def orderly() -> Iterator[None]:
    """Let the command inside end with an exit code of its own and at most one line, whatever happens around it.

    A signal ends it as Ctrl-C does: what it started ends too, and its folder is one that the same command continues.
    Where messages cannot be written they are left out; where results cannot be printed it ends, after what is saved.
    """
    for number in ENDING:
        if signal.getsignal(number) == signal.SIG_DFL:  # nohup has it ignored
            signal.signal(number, _end)
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it warns of a home without a place for its cache
    sys.stderr = _reopened(sys.stderr, _Messages)
    sys.stdout = _reopened(sys.stdout, _Results)
    try:
        yield
    finally:
        if sys.stdout:
            sys.stdout.flush()


def _end(number: int, frame: FrameType | None) -> None:
    for other in ENDING:
        signal.signal(other, signal.SIG_IGN)  # while things are put in order
    with suppress(OSError):
        os.write(2, f"ended by {signal.Signals(number).name}; the same command continues\n".encode())
    raise SystemExit(ENDING[signal.Signals(number)])


class _Messages(io.FileIO):
    """A stream that is silent once it fails: no work is lost because its messages cannot be read."""

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
        """What follows the first failure."""


class _Results(_Messages):
    """A stream whose failure ends the command."""

    def _give_up(self, error: OSError) -> None:
        if isinstance(error, BrokenPipeError):  # `| head` has read enough
            raise SystemExit(UNREAD)
        explanation = explained(error, Path("standard output"))
        print(f"{explanation} (what was saved is whole)", file=sys.stderr)
        raise SystemExit(explanation.exit_code)


def _reopened(stream: TextIO, kind: type[_Messages]) -> TextIO:
    """The same stream as a `kind`; letters that it does not have are written as `\\xe9`. None stays None."""
    try:
        raw = kind(stream.fileno(), "w", closefd=False)
    except (AttributeError, OSError, ValueError):  # closed, or no file
        return stream
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors="backslashreplace",
        line_buffering=bool(stream.line_buffering),
        write_through=kind is _Messages,
    )
