"""How a long computation reports its progress to its caller."""

from typing import Protocol


class Progress(Protocol):
    """Called with the number of finished units, the total, and a short remark for the display."""

    def __call__(self, done: int, total: int, remark: str = "") -> None: ...


def silent(done: int, total: int, remark: str = "") -> None:
    """The progress of a caller that does not watch."""
