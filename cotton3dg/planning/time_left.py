# SPDX-License-Identifier: Apache-2.0
"""The time that a run still takes: the expected times of its stages, corrected by the times of those that are done."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from ..core.machine import usable_cores
from ..pipeline import Step
from ..stage import STAGES
from ..workspace import Workspace

RESUMED: Final = 0.05
"""Share of a step: if its first message tells of more, an earlier run has done that."""

PRIOR_S: Final = 10.0
"""So many seconds as expected count beside what a run has taken, so that its first seconds decide nothing."""


class TimeLeft:
    """Follows a run step by step. Its clock is the caller's: every method takes the present time, s."""

    def __init__(self, expected_s: Mapping[str, float] | None = None, uncounted: tuple[str, ...] = ()) -> None:
        """Begin a run.

        Args:
            expected_s: step -> expected seconds, of the steps to come. Without it only the step at work counts.
            uncounted: steps that take time and have no number.
        """
        self.expected_s = dict(expected_s or {})
        self.numbers = {name: n for n, name in enumerate((s for s in self.expected_s if s not in uncounted), 1)}
        self._ahead_s = sum(self.expected_s.values())
        self._expected_so_far_s = self._taken_so_far_s = 0.0
        self.begin("", 0.0)

    def begin(self, name: str, now_s: float) -> None:
        """A step begins; those before it have ended, or were up to date."""
        self._name, self._began_s = name, now_s
        self._first: float | None = None
        self._share = 0.0
        if name in self.expected_s:
            place = list(self.expected_s).index(name)
            self._ahead_s = sum(list(self.expected_s.values())[place + 1 :])

    def advance(self, done: int, total: int, now_s: float) -> None:
        """The step at work has done `done` of `total` units; its first message says what an earlier run had done."""
        share = min(max(done / total, 0.0), 1.0) if total > 0 else 0.0
        if self._first is None:
            self._first = share if RESUMED < share < 1 else 0.0
            self._began_s = now_s if self._first else self._began_s
        self._share = max(0.0, (share - self._first) / (1 - self._first))

    def end(self, now_s: float) -> None:
        """The step at work ends."""
        if self._name in self.expected_s:
            self._expected_so_far_s += self._expected_own_s
            self._taken_so_far_s += now_s - self._began_s
        self.begin("", now_s)

    @property
    def place(self) -> str:
        """The place of the step at work among all, as `3 of 8`; empty if it is the only one or has no number."""
        number = self.numbers.get(self._name)
        return f"{number} of {len(self.numbers)}" if number and len(self.numbers) > 1 else ""

    def seconds(self, now_s: float) -> float:
        """Seconds that are left of the run; NaN if nothing is known of the step at work."""
        pace = self._pace(now_s)
        return self._own_s(now_s, pace) + pace * self._ahead_s

    def _pace(self, now_s: float) -> float:
        """How many times as long as expected the run takes, by all that it has done."""
        taken_s, expected_s = PRIOR_S + self._taken_so_far_s, PRIOR_S + self._expected_so_far_s
        if self._share > 0 and self._name in self.expected_s:
            taken_s += now_s - self._began_s
            expected_s += self._share * self._expected_own_s
        return taken_s / expected_s

    @property
    def _expected_own_s(self) -> float:
        """Seconds expected of the step at work, without what an earlier run had done; NaN if nothing is."""
        return self.expected_s.get(self._name, math.nan) * (1 - (self._first or 0.0))

    def _own_s(self, now_s: float, pace: float) -> float:
        """Seconds that are left of the step at work: as expected at its beginning, by its own pace towards its end."""
        taken_s, left = now_s - self._began_s, 1 - self._share
        expected_s = pace * self._expected_own_s
        if self._share == 0:
            return max(0.0, expected_s - taken_s) if math.isfinite(expected_s) else math.nan
        by_pace_s = taken_s * left / self._share
        return left * expected_s * left + self._share * by_pace_s if math.isfinite(expected_s) else by_pace_s


def time_left_of(workspace: Workspace, options: Mapping[str, Any], steps: list[Step]) -> TimeLeft:
    """The time left of a run before it begins.

    Args:
        options: of all stages. steps: of the run, as `pipeline.plan` finds them.
    Raises:
        Cotton3dgError: the capture is missing or cannot be read.
    """
    # Not at the top: commands that run nothing are quick without the rooms of the stages.
    from .calibrate import read_calibration
    from .cost import Machine, estimate_costs, examine_footage

    machine = read_calibration() or Machine(float(len(usable_cores())))
    costs = estimate_costs(options, examine_footage(workspace), machine)
    due = [step.stage for step in steps if step.reason]
    with_report = [*due, *(["report"] if STAGES[-1] in due else [])]
    return TimeLeft({name: costs[name].seconds(machine.cores) for name in with_report}, uncounted=("report",))
