# SPDX-License-Identifier: Apache-2.0
"""Errors a user can act on. Each carries the exit code of the command line.

Write messages as `what is wrong; what to do`: the command line puts the plant's name in front and prints one line.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Final


class Cotton3dgError(Exception):
    """Base of every error that is reported as one line instead of a traceback."""

    exit_code = 1


class BadUsage(Cotton3dgError):
    """The command, an option or a file cannot be used, or a stage is out of order."""

    exit_code = 2


class MissingInput(BadUsage):
    """A file that the user names, or that a stage reads, does not exist."""


class BadInput(BadUsage):
    """A file exists but cannot be what it should be."""


class EnvironmentUnusable(Cotton3dgError):
    """This machine lacks something: a library, ffmpeg, write permission."""

    exit_code = 3


class CaptureFailed(Cotton3dgError):
    """The video or the photos cannot be used, or structure from motion failed on them; film again."""

    exit_code = 4


class NoScale(Cotton3dgError):
    """No metric scale although the user required one."""

    exit_code = 5


class NoBolls(Cotton3dgError):
    """No masks or no bolls although the user required some."""

    exit_code = 6


class OutOfResources(Cotton3dgError):
    """Memory or disk is exhausted."""

    exit_code = 7


class StageFailed(Cotton3dgError):
    """A stage ended in a fault of its own; the log has the traceback."""

    exit_code = 1


DOUBTFUL: Final = 9
"""Exit code of a check that advises another film although this one is usable; not an error, the check is done."""

HUNG_UP: Final = 129
INTERRUPTED: Final = 130
UNREAD: Final = 141
TERMINATED: Final = 143
"""Exit codes of shells: after a closed terminal, Ctrl-C, a pipe whose reader has ended, SIGTERM."""

SOME_FAILED: Final = 8
"""Exit code if some of many are not done although the others are; not an error of its own."""

EXIT_CODES: Final = {
    0: "done",
    1: "a fault in the program",
    BadUsage.exit_code: "what was typed or given cannot be used: an option, a file, a stage out of order",
    EnvironmentUnusable.exit_code: "this machine lacks something: a library, ffmpeg, write permission",
    CaptureFailed.exit_code: "the capture cannot be used; film again",
    NoScale.exit_code: "no metric scale, but a scale is required",
    NoBolls.exit_code: "no bolls, but bolls are required",
    OutOfResources.exit_code: "memory or disk is exhausted",
    SOME_FAILED: "some of many are not done: plants of a batch, videos of an import, corrections",
    DOUBTFUL: "check: the film is usable, but better filmed again",
    HUNG_UP: "the terminal was closed; the same command continues",
    INTERRUPTED: "interrupted by Ctrl-C; the same command continues",
    UNREAD: "whatever reads the output has ended, as `head` does; what was saved is whole",
    TERMINATED: "ended by SIGTERM, as schedulers send it; the same command continues",
}
"""The meaning of each exit code of the command line; docs/troubleshooting.md and the manual page say the same."""


def unknown(what: str, word: str, known: Iterable[str]) -> BadUsage:
    """The error for `word`, a `what` that is not known; it names the likeliest known word, and all of them."""
    known = list(known)
    near = get_close_matches(word.lower(), known, 1)
    advice = f"did you mean {near[0]}? There are" if near else "use"
    return BadUsage(f"{what} is unknown; {advice} {', '.join(known)}")


@contextmanager
def as_capture_failure() -> Iterator[None]:
    """Report an unreadable file inside the block as a fault of the capture, for which another film may help."""
    try:
        yield
    except BadInput as error:
        raise CaptureFailed(str(error)) from error
