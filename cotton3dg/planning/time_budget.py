# SPDX-License-Identifier: Apache-2.0
"""The best settings that fit into a given time, and what they give up.

The run chooses twice: before any stage, and once the cameras are known. The steps of the training then take the time
that is left, so that a scene that was slower or quicker than expected costs steps instead of time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from .. import choices, pipeline
from ..choices import Asked, Chosen
from ..errors import BadUsage
from ..options import PRESET_VALUES
from ..pipeline import Watcher
from ..schemas.document import Document
from ..stage import STAGES, Footage
from ..workspace import Workspace
from .cost import Machine, estimate_costs, examine_footage, sum_seconds
from .tradeoff import format_duration

RECORD: Final = "time_budget"
RESERVE: Final = 0.05
"""Share of the time that is left unplanned: predictions err to both sides, and being late is worse."""


@dataclass(frozen=True)
class Rung:
    """Settings that go well together; more steps than `most` gain less than the next rung."""

    images: int
    max_side: int
    max_gaussians: int
    least: int
    most: int
    """Steps of the training."""

    def values(self, steps: int) -> dict[str, dict[str, Any]]:
        train = {
            "max_side": self.max_side,
            "max_gaussians": self.max_gaussians,
            "steps": steps,
        }
        return {"frames": {"count": self.images}, "train": train}


LADDER: Final = (
    Rung(150, 960, 1_000_000, 15_000, 30_000),
    Rung(150, 960, 300_000, 7000, 30_000),
    Rung(100, 960, 150_000, 2500, 10_000),
    Rung(80, 720, 100_000, 1500, 3500),
    Rung(60, 640, 60_000, 1200, 3000),
    Rung(50, 480, 40_000, 800, 1500),
    Rung(40, 320, 30_000, 500, 1200),
)
"""Fine to coarse: around the presets paper, standard and draft, and between and below them."""

Resolve = Callable[[dict[str, dict[str, Any]]], dict[str, Any]]
"""Turns the values of a rung into the options of all stages; values from the user win."""


@dataclass(frozen=True)
class Choice:
    """The settings that fit."""

    rung: Rung
    options: dict[str, Any]
    """Options of all stages."""
    expected_s: float


@dataclass(frozen=True)
class BudgetInfo(Document):
    """records/time_budget.json: the choice, for people only; no program reads it."""

    REMEDY = "run `cotton3dg run` with --time-budget"

    budget_s: float
    expected_s: float
    chosen: str


def choose(
    budget_s: float,
    resolve: Resolve,
    source: Footage,
    machine: Machine,
    spent_s: Mapping[str, float] | None = None,
    ladder: tuple[Rung, ...] = LADDER,
) -> Choice:
    """Choose the finest rung that fits, with as many steps as fit.

    Args:
        spent_s: stage -> seconds, for finished stages.
    Raises:
        BadUsage: not even the coarsest rung fits.
    """
    spent_s = spent_s or {}

    def expected(options: Mapping[str, Any]) -> float:
        ahead = {
            stage: cost for stage, cost in estimate_costs(options, source, machine).items() if stage not in spent_s
        }
        return sum(spent_s.values()) + sum_seconds(ahead, machine.cores)

    usable_s = (1 - RESERVE) * budget_s
    for rung in ladder:
        least = resolve(rung.values(rung.least))
        if expected(least) > usable_s and rung is not ladder[-1]:
            continue
        if expected(least) > budget_s and not spent_s:
            raise BadUsage(
                f"even the coarsest settings take about {format_duration(expected(least))} here;"
                " give a longer --time-budget"
            )
        low, high = rung.least, rung.most
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if expected(resolve(rung.values(middle))) <= usable_s else (low, middle)
        steps = rung.most if expected(resolve(rung.values(rung.most))) <= usable_s else low // 50 * 50
        options = resolve(rung.values(max(rung.least, steps)))
        return Choice(rung, options, expected(options))
    raise BadUsage("there are no settings to choose from")


def explain(choice: Choice, budget_s: float) -> str:
    """The choice, and what it gives up against the preset `paper`."""
    images, train = choice.options["frames"].count, choice.options["train"]
    finest = PRESET_VALUES["paper"]
    lost = [
        f"{whole:,} {name}"
        for name, value, whole in (
            ("images", images, finest["frames"]["count"]),
            ("steps", train.steps, finest["train"]["steps"]),
            ("Gaussians", train.max_gaussians, finest["train"]["max_gaussians"]),
            ("px", train.max_side, 960),
        )
        if value < whole
    ]
    return (
        f"time budget {format_duration(budget_s)}: {images} images of {train.max_side} px, {train.steps:,} steps,"
        f" {train.max_gaussians:,} Gaussians, about {format_duration(choice.expected_s)}"
        + (f"; gives up the preset paper's {', '.join(lost)}" if lost else "")
    )


class Budget:
    """A run of one plant that takes at most `budget_s` seconds on an otherwise idle machine.

    Finished stages count with the seconds that they took, so that the same command always chooses the same and resumes.
    """

    def __init__(
        self,
        workspace: Workspace,
        budget_s: float,
        machine: Machine,
        asked: Asked | None = None,
        tell: Callable[[str], None] = print,
    ):
        self.workspace, self.budget_s, self.machine, self.tell = workspace, budget_s, machine, tell
        self.asked = asked or Asked()
        self.source = examine_footage(workspace)
        self.choice = choose(budget_s, self._resolve, self.source, machine)
        tell(explain(self.choice, budget_s))

    def _resolve(self, values: dict[str, dict[str, Any]]) -> dict[str, Any]:
        return self._choose(values).options

    def _choose(self, values: dict[str, dict[str, Any]]) -> Chosen:
        return choices.choose(self.workspace, replace(self.asked, budgeted=values))

    @property
    def chosen(self) -> Chosen:
        """The options of the choice."""
        return self._choose(self.choice.rung.values(self.choice.options["train"].steps))

    def _run(self, stages: tuple[str, ...], **how: Any) -> None:
        chosen = self.chosen
        pipeline.run(self.workspace, chosen.options, stages, choices=chosen.to_keep(stages), **how)

    def run(
        self, *, force: bool = False, wait: bool = False, watcher: Watcher | None = None, report: bool = False
    ) -> None:
        """Run all stages, as `pipeline.run` does; choose the steps again once the cameras are known."""
        early, late = pipeline.selected(STAGES[0], "sfm"), pipeline.selected("train", STAGES[-1])
        self._run(early, force=force, wait=wait, watcher=watcher)
        records = [record for record in map(self.workspace.read_record, early) if record]
        spent_s = {record.stage: record.seconds for record in records}
        self.choice = choose(
            self.budget_s, self._resolve, self.source, self.machine, spent_s, ladder=(self.choice.rung,)
        )
        words = explain(self.choice, self.budget_s)
        self.tell(f"cameras took {format_duration(sum(spent_s.values()))}; {words}")
        self.workspace.keep(BudgetInfo(self.budget_s, self.choice.expected_s, words), RECORD)
        self._run(late, force=force, wait=wait, watcher=watcher, report=report)
