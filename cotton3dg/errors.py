"""Errors a user can act on. Each carries the exit code of the command line.

Write messages as `what is wrong; what to do`: the command line puts the plant's name in front and prints one line.
"""

from typing import Final


class Cotton3dgError(Exception):
    """Base of every error that is reported as one line instead of a traceback."""

    exit_code = 1


class BadUsage(Cotton3dgError):
    """An option, a TOML key or a command line that makes no sense."""

    exit_code = 2


class EnvironmentUnusable(Cotton3dgError):
    """Something this machine lacks: a library, ffmpeg, write permission."""

    exit_code = 3


class CaptureFailed(Cotton3dgError):
    """The video or the photos cannot be used, or structure from motion failed on them."""

    exit_code = 4


class MissingInput(CaptureFailed):
    """A file that a stage reads does not exist."""


class BadInput(CaptureFailed):
    """A file exists but cannot be what it should be."""


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
"""Exit code of a check that would have a film, though usable, filmed again: no error, the check was done."""

SOME_FAILED: Final = 8
"""Exit code of a batch when some plants failed or were not tried: no error of its own, the others are done."""
