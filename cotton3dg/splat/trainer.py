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

from ..core.progress import Progress, silent
from ..core.scene import Camera, Gaussians
from ..errors import StageFailed
from ..geometry.camera_orbit import Orbit, fit_orbit
from ..options import TrainOptions
from . import densify
from .metrics import PLANT_REGION
from .random_streams import open_stream
from .rasterizer import StepReport, Window, train_step
from .state import NO_SURROUNDINGS, AdamState, DensityStatistics, LearningRates, Surroundings
from .views import View

COARSEST_SIDE_PX: Final = 200
"""Images are not reduced below this: there is nothing left to learn from."""

LEVEL_SHARES: Final = {1: (1.0,), 2: (0.3, 0.7), 3: (0.15, 0.25, 0.6)}
"""Share of the steps at each resolution, coarse to fine, by the number of resolutions."""

DENSIFY_FROM: Final = 0.05
DENSIFY_UNTIL: Final = 0.4
"""Shares of the steps between which the number of Gaussians changes: it is settled when the finest images come, so that
most of the costly steps can look at the plant alone."""

N_DENSIFICATIONS: Final = 25
"""How often it changes, unless that would be more than once for each image."""

PAPER_STEPS: Final = 30_000
"""Length of training in Kerbl et al. 2023, which their learning rates are made for."""

SETTLING_FROM: Final = 0.75
SETTLED: Final = 0.1
"""From this share of the steps on the rates fall, to this share of themselves, so that the model settles."""

SURROUNDINGS_GROWTH: Final = 2.5
"""How much longer the steps of means and log scales get for each radius of the plant region that they are beyond it:
a room's Gaussians are some ten times as large as a plant's, and the rate that suits a boll leaves a wall unfinished."""

SURROUNDINGS_MEANS: Final = 20.0
SURROUNDINGS_LOG_SCALES: Final = 3.0
"""How many times as long they become at most."""

SURROUNDINGS_STEPS: Final = 500
"""In trainings of fewer steps all are as long as they can be."""

SH_RAISED_EVERY: Final = 0.15
"""Share of the steps after which the degree of the colour rises by one."""

MOST_REJECTED: Final = 0.02
"""Share of the steps that may be rejected for a non-finite loss before training counts as failed."""


FEWEST_REJECTED: Final = 10
"""So many rejected steps are tolerated in the shortest training."""

WHOLE_EVERY: Final = 4
"""Once the number of Gaussians is settled, a view is trained on whole in one of so many epochs, else on the window that
shows the plant."""

RECORDED_EVERY: Final = 50
"""Steps between two entries of the history."""

UNUSABLE: Final = ("non_finite", "degenerate")
"""Reasons for culling that tell of numerical trouble; the others tell of Gaussians out of view."""

SAVED_EVERY_S: Final = 60.0
"""Seconds between two saves of the training, so that no interruption costs more."""

CLOSEST: Final = 0.15
"""Nothing solid is nearer to a camera than this share of the cameras' distance from what they look at."""

PLANT_NEED: Final = 5.0
"""How much more a Gaussian in the plant region needs splitting than one of the room with the same gradient."""

LARGEST_IN_PLANT: Final = 0.01
"""Longest σ in the plant region relative to the cameras' distance: some 1.2 cm where a plant fills the image, a third
of a boll, so that surfaces to be measured are sampled even where lint is too white to call for it. Half of it spends a
small budget on the table top and leaves nothing for detail."""

LARGEST_IN_ROOM: Final = 0.05
"""Longest σ elsewhere relative to the distance from the orbit's centre."""


@dataclass
class Fit:
    """The model and what is known about its making."""

    gaussians: Gaussians
    history: list[dict[str, Any]] = field(default_factory=list)
    """Every RECORDED_EVERY steps: step, seconds, cpu_seconds, n_gaussians, width_px, loss (mean since the last)."""
    rejected: list[tuple[int, str]] = field(default_factory=list)
    """Steps and images whose loss was not finite; they changed nothing."""
    culled: dict[str, int] = field(default_factory=dict)
    """Gaussians skipped for being numerically unusable, by reason, over all steps."""
    n_skipped: int = 0
    """Updates of single Gaussians left out, over all steps, because their gradient was not finite. Who is skipped all
    the time counts as seen by no view and is pruned."""
    n_pruned: int = 0
    n_split: int = 0


@dataclass
class Training:
    """A training between two steps: all that it needs, besides its arguments, to go on as if it had never stopped."""

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
"""Called between two steps with what has to be written down at once: the next step changes it."""

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

    A `Training` that `save` was given at any step, with otherwise the same arguments, leads to the same result too;
    it is used up.

    Args:
        windows: what of each view shows the plant (plant_windows.py), None = all of it. They take most of the last
            steps, after the last densification: before it every view has to show what it does not need.
    Raises:
        ValueError: `start` is larger than the budget.
        StageFailed: the loss was not finite in more than MOST_REJECTED of the steps, or every Gaussian was lost.
    """
    training = Training.of(start) if isinstance(start, Gaussians) else start
    if training.n_start > options.max_gaussians:
        raise ValueError(f"{training.n_start} Gaussians to start from, but a budget of {options.max_gaussians}")
    result, schedule = training.fit, _Schedule.of(views, options, windows or [None] * len(views))
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


@dataclass(frozen=True)
class _Schedule:
    """What a training does at which step: it follows from the views and the options alone."""

    options: TrainOptions
    cameras: list[Camera]
    orbit: Orbit
    around: Surroundings
    levels: list[tuple[int, list[View]]]
    """The views from coarse to fine, as `resolutions` has them."""
    order: list[int]
    """Index of the view of each step."""
    densifications: range
    windows: Sequence[Window | None]
    """Of the views at the finest resolution."""

    @staticmethod
    def of(views: Sequence[View], options: TrainOptions, windows: Sequence[Window | None]) -> _Schedule:
        cameras = [view.camera for view in views]
        orbit = fit_orbit(cameras)
        return _Schedule(
            options,
            cameras,
            orbit,
            surroundings(orbit, options.steps),
            resolutions(views, options.steps),
            image_order(len(views), options.steps, options.seed),
            densification_steps(options.steps, len(views)),
            windows,
        )

    def view(self, step: int) -> View:
        return next(level for until, level in self.levels if step < until)[self.order[step]]

    def window(self, step: int) -> Window | None:
        """What of its view a step looks at; None = all of it."""
        coarse = [until for until, _ in self.levels[:-1]]
        if step < max([*coarse, *self.densifications[-1:]], default=0):
            return None
        index, epoch = self.order[step], step // len(self.cameras)
        return None if (epoch + index) % WHOLE_EVERY == 0 else self.windows[index]


def _take_step(training: Training, view: View, step: int, schedule: _Schedule) -> StepReport:
    options = schedule.options
    return train_step(
        training.fit.gaussians,
        training.adam,
        training.statistics,
        view.camera,
        view.image,
        sh_degree=min(options.sh_degree, int(step / (SH_RAISED_EVERY * options.steps))),
        background=(0.0, 0.0, 0.0),
        learning_rates=learning_rates(step, options.steps, schedule.orbit.distance, schedule.around),
        dssim=options.dssim,
        window=schedule.window(step),
    )


def _control_density(training: Training, done: int, schedule: _Schedule) -> None:
    """Split and prune after `done` steps."""
    result, steps = training.fit, schedule.densifications
    share = (steps.index(done) + 1) / len(steps)
    count = densify.scheduled_count(training.n_start, schedule.options.max_gaussians, share)
    densified = _densify(result.gaussians, training.statistics, schedule.cameras, schedule.orbit, count)
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


def _drop_superfluous(training: Training, schedule: _Schedule) -> None:
    """Leave out what no view needed since the last densification."""
    result, last = training.fit, schedule.densifications[-1] if schedule.densifications else 0
    keep = _find_worth_keeping(result.gaussians, training.statistics, schedule.cameras, schedule.orbit)
    # Whoever has not been looked for in every view cannot be called hidden.
    if keep.any() and schedule.options.steps - last >= len(schedule.cameras):
        result.n_pruned += int((~keep).sum())
        result.gaussians = result.gaussians[keep]


def resolutions(views: Sequence[View], steps: int) -> list[tuple[int, list[View]]]:
    """The views from coarse to fine, each resolution with the step that ends its use."""
    side = max(max(view.image.shape) for view in views)
    return [(until, [view.limited(side / factor) for view in views]) for until, factor in levels(side, steps)]


def levels(side_px: int, steps: int) -> list[tuple[int, int]]:
    """By how much images are reduced, coarse to fine, each factor after the step that ends its use."""
    factors = [factor for factor in (4, 2, 1) if factor == 1 or side_px / factor >= COARSEST_SIDE_PX]
    untils = np.rint(np.cumsum(LEVEL_SHARES[len(factors)]) * steps).astype(int).tolist()
    return list(zip(untils, factors, strict=True))


def densification_steps(steps: int, n_views: int) -> range:
    """Numbers of finished steps after which the density is controlled.

    Always after whole epochs: a window that misses views finds what only those show hidden.
    """
    epochs = max(1, round((DENSIFY_UNTIL - DENSIFY_FROM) * steps / N_DENSIFICATIONS / n_views))
    first = math.ceil(DENSIFY_FROM * steps / n_views) + epochs
    return range(first * n_views, round(DENSIFY_UNTIL * steps) + 1, epochs * n_views)


def image_order(n_views: int, steps: int, seed: int) -> list[int]:
    """Index of the view of each step: all views once, in random order, then all again in another."""
    rng = open_stream(seed, "image order")
    epochs = [rng.permutation(n_views) for _ in range(math.ceil(steps / n_views))]
    return np.concatenate(epochs)[:steps].tolist()


def learning_rates(step: int, steps: int, radius_su: float, around: Surroundings = NO_SURROUNDINGS) -> LearningRates:
    """Rates of step `step` of `steps`; that of the means grows with the scene.

    At 30,000 steps they start as those of Kerbl et al. 2023. A shorter run must cover the same way in fewer steps: all
    rates grow as the run gets shorter. The means' fall all the time, as in the paper, to a hundredth; the others,
    constant there, fall at the end. The exponents were fitted to runs of 1000 steps on 480 px and 3000 steps on 960 px
    images, where they gain 3 dB and 2 dB; that of view dependence to 2000 steps on 480 px. `around` the plant the rates
    grow with the distance, unlike in the paper.
    """
    progress = step / steps
    shortness = max(1.0, PAPER_STEPS / steps)
    settling = SETTLED ** max(0.0, (progress - SETTLING_FROM) / (1 - SETTLING_FROM))
    return LearningRates(
        means=1.6e-4 * radius_su * shortness**0.6 * 0.01**progress,
        quats=1e-3 * shortness**0.7 * settling,
        log_scales=5e-3 * shortness**0.7 * settling,
        opacity_logits=5e-2 * min(2.0, shortness) * settling,
        sh0=2.5e-3 * min(2.0, shortness) * settling,
        sh_rest=2.5e-3 / 20 * min(40.0, shortness) * settling,
        surroundings=around,
    )


def surroundings(orbit: Orbit, steps: int) -> Surroundings:
    """Where a training of `steps` steps takes longer ones."""
    if steps < SURROUNDINGS_STEPS:
        return NO_SURROUNDINGS
    x, y, z = orbit.centre
    return Surroundings(
        (float(x), float(y), float(z)),
        PLANT_REGION * orbit.distance,
        SURROUNDINGS_GROWTH,
        SURROUNDINGS_MEANS,
        SURROUNDINGS_LOG_SCALES,
    )


def _note(result: Fit, report: StepReport, step: int, name: str, steps: int) -> None:
    """Count what one step skipped or rejected."""
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
    gaussians: Gaussians, statistics: DensityStatistics, cameras: Sequence[Camera], orbit: Orbit, count: int
) -> densify.Densified:
    """Density control that favours the plant: what the cameras look at is what gets measured."""
    distances = np.linalg.norm(gaussians.means - orbit.centre, axis=1)
    inside = distances <= PLANT_REGION * orbit.distance
    need = densify.growth_score(statistics.abs_grad_px, statistics.count) * np.where(inside, PLANT_NEED, 1.0)
    largest = np.where(inside, LARGEST_IN_PLANT * orbit.distance, LARGEST_IN_ROOM * distances)
    oversized = np.exp(gaussians.log_scales.max(axis=1)) / largest
    # Anything oversized comes before anything else, the worst first; 1e6 only has to exceed every gradient.
    need = np.where(oversized > 1, 1e6 * oversized, need)
    keep = _find_worth_keeping(gaussians, statistics, cameras, orbit)
    return densify.densify(gaussians, keep, need, count)


def _find_worth_keeping(
    gaussians: Gaussians, statistics: DensityStatistics, cameras: Sequence[Camera], orbit: Orbit
) -> NDArray[np.bool_]:
    centres = np.array([camera.centre for camera in cameras])
    keep = densify.find_worth_keeping(gaussians, centres, CLOSEST * orbit.distance)
    return keep & densify.find_contributing(statistics.weight, statistics.count)
