# SPDX-License-Identifier: Apache-2.0
"""How far a command is: one line on a terminal, of any width; elsewhere a plain line every 10 s."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Final

from rich.console import Console
from rich.live import Live
from rich.text import Text

from .. import pipeline
from ..core.runs import Progress as StageProgress
from ..errors import Cotton3dgError
from ..pipeline import Step, Watcher
from ..planning.time_left import TimeLeft, time_left_of
from ..planning.tradeoff import format_duration
from ..schemas.record import Record
from ..workspace import Workspace

PLAIN_INTERVAL_S: Final = 10.0
"""How often a line is printed where there is no terminal."""
REFRESHES: Final = 4
"""How often the line on a terminal is drawn, 1/s."""
MOST_PCT: Final = 99
"""What is shown of work that has done all its units and still tidies up."""


@dataclass
class Work:
    """The step at work."""

    name: str
    began_s: float
    done: int = 0
    total: int = 0
    remark: str = ""


class ProgressDisplay(Watcher):
    """Shows the step at work and the time left."""

    def __init__(self, loud: bool | None = None, stages: tuple[str, ...] = ()) -> None:
        """Watch what a command does.

        Args:
            loud: True shows figures and reasons, too, and False nothing.
            stages: all stages of work that several runs make up.
        """
        self.loud, self.stages = loud, stages
        self.console = Console(stderr=True, quiet=loud is False)
        self.time_left = TimeLeft()
        self.work: Work | None = None
        self.began_s = time.monotonic()
        self.live = Live(
            get_renderable=self._line,
            console=self.console,
            refresh_per_second=REFRESHES,
            transient=True,
            redirect_stdout=False,
        )

    def __enter__(self) -> ProgressDisplay:
        if self.console.is_terminal and self.loud is not False:
            self.live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.work = None
        self.live.stop()

    def begins(self, workspace: Workspace, options: dict[str, Any], stages: tuple[str, ...], force: bool) -> None:
        if self.loud is False or (self.stages and self.time_left.expected_s):
            return
        self.time_left = TimeLeft()
        with suppress(Cotton3dgError):  # the run itself says what is wrong
            steps = pipeline.plan(workspace, options, self.stages or stages, force=force)
            self.time_left = time_left_of(workspace, options, steps)

    def started(self, step: Step) -> StageProgress:
        return self.watched(step.stage, step.reason)

    def watched(self, name: str, reason: str = "") -> StageProgress:
        """The progress of anything that takes a while."""
        now = time.monotonic()
        self.work = Work(name, now)
        self.time_left.begin(name, now)
        if not self.console.is_terminal:
            self.say(f"{name}: starts" + (f" ({reason})" if reason and self.loud else ""))
        return self._advance(self.work)

    def _advance(self, work: Work) -> StageProgress:
        last_s = work.began_s
        first: int | None = None  # where an interrupted run goes on, some is done at the beginning

        def show(done: int, total: int, remark: str = "") -> None:
            nonlocal first, last_s
            now = time.monotonic()
            first = done if first is None else first
            work.done, work.total, work.remark = done, total, remark
            self.time_left.advance(done, total, now)
            if self.console.is_terminal or now - last_s < PLAIN_INTERVAL_S or done == first:
                return
            last_s = now
            left_s = self.time_left.seconds(now)
            left = f", about {format_duration(left_s)} left" if math.isfinite(left_s) else ""
            self.say(f"{self._named(work)}: {done}/{total}{remark and f' {remark}'}{left}")

        return show

    def _named(self, work: Work) -> str:
        return f"{work.name} ({self.time_left.place})" if self.time_left.place else work.name

    def finished(self, step: Step, record: Record) -> None:
        self.time_left.end(time.monotonic())
        self.work = None
        facts = ", ".join(f"{key} {_short(value)}" for key, value in list(record.summary.items())[:4])
        self.say(f"{step.stage}: done in {record.seconds:.1f} s" + (f" ({facts})" if facts and self.loud else ""))
        for warning in record.warnings:
            self.say(f"{step.stage}: warning: {warning}")

    def skipped(self, step: Step) -> None:
        self.say(f"{step.stage}: up to date")

    def reported(self, remark: str) -> None:
        self.work = None
        self.say(f"report: {remark}")

    def say(self, line: str) -> None:
        """Print a line above the one that shows the progress."""
        if self.console.is_terminal:
            self.console.print(line, markup=False, highlight=False, soft_wrap=True)
        elif self.loud is not False:
            print(line, file=sys.stderr, flush=True)

    def _line(self) -> Text:
        work, now = self.work, time.monotonic()
        if work is None:
            return Text("")
        share = f"{min(MOST_PCT, 100 * work.done // work.total)} %" if work.total > 0 else ""
        head = " ".join(part for part in (self.time_left.place, work.name, share) if part)
        left_s = self.time_left.seconds(now)
        left = f"about {format_duration(left_s)} left" if math.isfinite(left_s) else ""
        line = fitting((head, left, f"{format_duration(now - self.began_s)} so far", work.remark), self.console.width)
        return Text(line, no_wrap=True, overflow="ellipsis")


def fitting(parts: Iterable[str], width: int) -> str:
    """The parts that fit into a line, the first of them in any case; those that come first matter most."""
    line = ""
    for part in filter(None, parts):
        longer = f"{line}, {part}" if line else part
        if line and len(longer) > width:
            break
        line = longer
    return line


def teller(loud: bool | None) -> Callable[[str], None]:
    """Prints lines about the work; none with --quiet."""
    return lambda line: None if loud is False else print(line, file=sys.stderr, flush=True)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
