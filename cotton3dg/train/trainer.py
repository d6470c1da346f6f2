# SPDX-License-Identifier: Apache-2.0
"""Fitting Gaussians to photos: the training loop of 3D Gaussian splatting on a budget.

Loss, optimiser and learning rates follow Kerbl et al. 2023. Resolution and number of Gaussians grow together (coarse
to fine, after DashGaussian, Chen et al. 2025), because early steps at full size cost most and teach least.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.runs import Progress, silent
from ..core.scene import Gaussians
from ..errors import StageFailed
from ..gaussians.metrics import PLANT_REGION
from ..gaussians.rasterizer import StepReport, Window, train_step
from ..gaussians.state import AdamState, DensityStatistics
from ..gaussians.views import View
from ..geometry.camera_orbit import Orbit
from ..options import TrainOptions
from . import densify
from .schedule import Schedule

MOST_REJECTED: Final = 0.02
"""Share of the steps that may be rejected for a non-finite loss before training counts as failed."""

FEWEST_REJECTED: Final = 10
"""Number of rejected steps that even the shortest training tolerates."""

RECORDED_EVERY: Final = 50
"""Steps between two entries of the history."""

UNUSABLE: Final = ("non_finite", "degenerate")
"""Reasons for culling that mean numerical trouble; the others mean that a Gaussian is out of view."""

SAVED_EVERY_S: Final = 60.0
"""Seconds between two saves of the training, so that no interruption costs more."""

CLOSEST: Final = 0.15
"""Nothing solid is nearer to a camera than this share of the cameras' distance from their target."""

PLANT_NEED: Final = 5.0
"""How much more a Gaussian in the plant region needs splitting than one of the room with the same gradient."""

LARGEST_IN_PLANT: Final = 0.01
"""Longest σ in the plant region relative to the cameras' distance: some 1.2 cm where a plant fills the image, a third
of a boll, so that the measured surfaces are sampled even where lint is too white to cause splits. Half of this length
would spend a small budget on the table top and leave nothing for detail."""

LARGEST_IN_ROOM: Final = 0.05
"""Longest σ elsewhere relative to the distance from the orbit's centre."""


@dataclass
class Fit:
    """The model and the record of its training."""

    gaussians: Gaussians
    history: list[dict[str, Any]] = field(default_factory=list)
    """Every RECORDED_EVERY steps: step, seconds, cpu_seconds, n_gaussians, width_px, loss (mean since the last)."""
    rejected: list[tuple[int, str]] = field(default_factory=list)
    """Steps and images whose loss was not finite; they changed nothing."""
    culled: dict[str, int] = field(default_factory=dict)
    """Gaussians skipped for being numerically unusable, by reason, over all steps."""
    n_skipped: int = 0
    """Updates of single Gaussians left out, over all steps, because their gradient was not finite. A Gaussian that is
    always skipped counts as seen by no view and is pruned."""
    n_pruned: int = 0
    n_split: int = 0
    budget: int | None = None
    """Largest number of Gaussians; None where the training adds none."""


@dataclass
class Training:
    """A training between two steps: its state, which with its arguments suffices to go on as if it never stopped."""

    fit: Fit
    adam: AdamState
    statistics: DensityStatistics
    n_start: int
    """Gaussians at the beginning."""
    step: int = 0
    """Steps done."""
    losses: list[float] = field(default_factory=list)
    """Since the last entry of the history."""
    seconds: float = 0.0
    cpu_seconds: float = 0.0

    @staticmethod
    def of(start: Gaussians) -> Training:
        """The beginning, with arrays of its own."""
        own = Fit(densify.concatenate([start]))
        return Training(own, AdamState.zeros(start), DensityStatistics.zeros(len(start)), len(start))


Watch = Callable[[int, Gaussians], None]
"""Called after every step with the number of steps done and the current Gaussians, which it must not change."""

Save = Callable[[Training], None]
"""Called between two steps with the state, which has to be saved at once because the next step changes it."""

Keep = Callable[[Training, View], None]
"""Called with the state and the view of the first rejected step, for diagnosis."""


def fit(
    start: Gaussians | Training,
    views: Sequence[View],
    options: TrainOptions,
    progress: Progress = silent,
    watch: Watch | None = None,
    save: Save | None = None,
    keep_rejected: Keep | None = None,
    windows: Sequence[Window | None] | None = None,
) -> Fit:
    """Train `start` on `views`; the same arguments give the same result, bit by bit, on one machine and build.

    A `Training` that `save` received at any step leads to the same result, too, if the other arguments are the same;
    it is used up.

    Args:
        windows: the part of each view that shows the plant (plant_windows.py), None = all of it. Most of the last
            steps, after the last densification, use them: before it every view has to show what it does not need.
    Raises:
        ValueError: `start` is larger than the budget.
        StageFailed: the loss was not finite in more than MOST_REJECTED of the steps, or every Gaussian was lost.
    """
    training = Training.of(start) if isinstance(start, Gaussians) else start
    if training.n_start > options.max_gaussians:
        raise ValueError(f"{training.n_start} Gaussians to start from, but a budget of {options.max_gaussians}")
    result, schedule = training.fit, Schedule.of(views, options, windows or [None] * len(views))
    result.budget = options.max_gaussians
    saved = time.perf_counter()
    began, cpu_began = saved - training.seconds, time.process_time() - training.cpu_seconds

    def read_clocks() -> None:
        training.seconds, training.cpu_seconds = time.perf_counter() - began, time.process_time() - cpu_began

    for step in range(training.step, options.steps):
        view = schedule.view(step)
        report = _take_step(training, view, step, schedule)
        training.losses += [report.loss] if report.finite else []
        if not report.finite and keep_rejected and not result.rejected:
            keep_rejected(training, view)
        _note(result, report, step, view.camera.name, options.steps)
        if step + 1 in schedule.densifications:
            _control_density(training, step + 1, schedule)
        if (step + 1) % RECORDED_EVERY == 0 or step + 1 == options.steps:
            read_clocks()
            entry = _recorded(training, step + 1, view.camera.width)
            progress(step + 1, options.steps, f"loss {entry['loss']:.4f}, {entry['n_gaussians']} Gaussians")
        training.step = step + 1
        if watch:
            watch(step + 1, result.gaussians)
        if save and time.perf_counter() - saved >= SAVED_EVERY_S:
            read_clocks()
            save(training)
            saved = time.perf_counter()
    _drop_superfluous(training, schedule)
    return result


def _take_step(training: Training, view: View, step: int, schedule: Schedule) -> StepReport:
    return train_step(
        training.fit.gaussians,
        training.adam,
        training.statistics,
        view.camera,
        view.image,
        sh_degree=schedule.sh_degree(step),
        learning_rates=schedule.learning_rates(step),
        rate_factors=schedule.rate_factors(training.fit.gaussians.means),
        dssim=schedule.options.dssim,
        window=schedule.window(step),
    )


def _control_density(training: Training, done: int, schedule: Schedule) -> None:
    """Split and prune after `done` steps."""
    result, steps = training.fit, schedule.densifications
    share = (steps.index(done) + 1) / len(steps)
    count = densify.scheduled_count(training.n_start, schedule.options.max_gaussians, share)
    keep = _find_worth_keeping(training, done, schedule)
    densified = _densify(result.gaussians, keep, training.statistics, schedule.orbit, count)
    if len(densified.gaussians) == 0:
        raise StageFailed("training lost every Gaussian; run again with more steps or another --seed")
    result.n_pruned += densified.n_pruned
    result.n_split += densified.n_split
    result.gaussians = densified.gaussians
    training.adam = training.adam.carried_over(densified.rows, densified.continued)
    training.statistics = DensityStatistics.zeros(len(result.gaussians))


def _recorded(training: Training, done: int, width_px: int) -> dict[str, Any]:
    """The new last entry of the history."""
    entry = {
        "step": done,
        "seconds": round(training.seconds, 3),
        "cpu_seconds": round(training.cpu_seconds, 3),
        "n_gaussians": len(training.fit.gaussians),
        "width_px": width_px,
        "loss": float(np.mean(training.losses)) if training.losses else math.nan,
    }
    training.fit.history.append(entry)
    training.losses.clear()
    return entry


def _drop_superfluous(training: Training, schedule: Schedule) -> None:
    """Drop the Gaussians that no view needed since the last densification."""
    result = training.fit
    keep = _find_worth_keeping(training, schedule.options.steps, schedule)
    if keep.any():
        result.n_pruned += int((~keep).sum())
        result.gaussians = result.gaussians[keep]


def _note(result: Fit, report: StepReport, step: int, name: str, steps: int) -> None:
    """Record what one step skipped or rejected."""
    for reason in UNUSABLE:
        result.culled[reason] = result.culled.get(reason, 0) + report.culled.get(reason, 0)
    result.n_skipped += report.n_skipped
    if not report.finite:
        result.rejected.append((step, name))
        if len(result.rejected) > max(FEWEST_REJECTED, MOST_REJECTED * steps):
            raise StageFailed(
                f"the loss was not finite in {len(result.rejected)} of {step + 1} steps, last for {name}; "
                "leave out that image or run again with another seed"
            )


def _densify(
    gaussians: Gaussians, keep: NDArray[np.bool_], statistics: DensityStatistics, orbit: Orbit, count: int
) -> densify.Densified:
    """Density control that favours the plant, because the plant is measured."""
    distances = np.linalg.norm(gaussians.means - orbit.centre, axis=1)
    inside = distances <= PLANT_REGION * orbit.distance
    need = densify.growth_score(statistics.abs_grad_px, statistics.count) * np.where(inside, PLANT_NEED, 1.0)
    largest = np.where(inside, LARGEST_IN_PLANT * orbit.distance, LARGEST_IN_ROOM * distances)
    oversized = np.exp(gaussians.log_scales.max(axis=1)) / largest
    # Anything oversized comes before anything else, the worst first; 1e6 only has to exceed every gradient.
    need = np.where(oversized > 1, 1e6 * oversized, need)
    return densify.densify(gaussians, keep, need, count)


def _find_worth_keeping(training: Training, done: int, schedule: Schedule) -> NDArray[np.bool_]:
    """(N,) which Gaussians stay after `done` steps."""
    centres = np.array([camera.centre for camera in schedule.cameras])
    keep = densify.find_worth_keeping(training.fit.gaussians, centres, CLOSEST * schedule.orbit.distance)
    if schedule.hidden_are_known(done):
        keep &= densify.find_contributing(training.statistics.weight, training.statistics.count)
    return keep
