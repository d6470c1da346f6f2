# SPDX-License-Identifier: Apache-2.0
"""The plan of a training, step by step. It follows from the views and the options alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..core.scene import Camera, Float32
from ..gaussians.metrics import PLANT_REGION
from ..gaussians.rasterizer import Window
from ..gaussians.state import LearningRates
from ..gaussians.views import View
from ..geometry.camera_orbit import Orbit, fit_orbit
from ..options import TrainOptions
from .random_streams import open_stream

COARSEST_SIDE_PX: Final = 200
"""Images are not reduced below this size: smaller ones do not teach anything."""

LEVEL_SHARES: Final = {1: (1.0,), 2: (0.3, 0.7), 3: (0.15, 0.25, 0.6)}
"""Share of the steps at each resolution, coarse to fine, by the number of resolutions."""

DENSIFY_AFTER: Final = 0.05
"""Share of the steps, rounded up to whole epochs, that come before the first stretch with a change at its end."""

DENSIFY_EVERY: Final = 0.014
"""Length of such a stretch as a share of the steps, rounded to whole epochs: one with `standard` and `draft`."""

DENSIFY_UNTIL: Final = 0.4
"""Share of the steps after which the density is settled. The finest images come then, so that most of the costly steps
can use the plant alone."""

FEWEST_DENSIFICATIONS: Final = 4
"""Least number of changes. Where whole epochs leave room for fewer, this many share the time, as each at most doubles
the number of Gaussians."""

PAPER_STEPS: Final = 30_000
"""Length of training in Kerbl et al. 2023, for which their learning rates are made."""

SHORTEST_STEPS: Final = 250
"""Shorter trainings have the rates of this length, as longer steps overshoot."""

SETTLING_FROM: Final = 0.75
SETTLED: Final = 0.1
"""From this share of the steps on the rates fall, to this share of themselves, so that the model settles."""

SURROUNDINGS_GROWTH: Final = 2.5
"""How much longer the steps of means and log scales get with each radius of the plant region beyond it. A room's
Gaussians are some ten times as large as a plant's, and the rate that suits a boll leaves a wall unfinished."""

SURROUNDINGS_MEANS: Final = 20.0
SURROUNDINGS_LOG_SCALES: Final = 3.0
"""Largest factor by which these steps become longer."""

SURROUNDINGS_STEPS: Final = 500
"""Trainings of fewer steps make all these steps as long as possible."""

SH_RAISED_EVERY: Final = 0.15
"""Share of the steps after which the degree of the colour rises by one."""

WHOLE_EVERY: Final = 4
"""Once the number of Gaussians is settled, one epoch in this many trains on whole views; the others train on the window
that shows the plant."""


@dataclass(frozen=True)
class Schedule:
    """The plan of a training, step by step."""

    options: TrainOptions
    cameras: list[Camera]
    orbit: Orbit
    levels: list[tuple[int, list[View]]]
    """The views from coarse to fine, as `resolutions` has them."""
    order: list[int]
    """Index of the view of each step."""
    densifications: range
    windows: Sequence[Window | None]
    """Of the views at the finest resolution."""

    @staticmethod
    def of(views: Sequence[View], options: TrainOptions, windows: Sequence[Window | None]) -> Schedule:
        cameras = [view.camera for view in views]
        orbit = fit_orbit(cameras)
        return Schedule(
            options,
            cameras,
            orbit,
            resolutions(views, options.steps),
            image_order(len(views), options.steps, options.seed),
            densification_steps(options.steps, len(views)),
            windows,
        )

    def view(self, step: int) -> View:
        return next(level for until, level in self.levels if step < until)[self.order[step]]

    def window(self, step: int) -> Window | None:
        """The part of its view that a step uses; None = all of it."""
        coarse = [until for until, _ in self.levels[:-1]]
        if step < max([*coarse, *self.densifications[-1:]], default=0):
            return None
        index, epoch = self.order[step], step // len(self.cameras)
        return None if (epoch + index) % WHOLE_EVERY == 0 else self.windows[index]

    def sh_degree(self, step: int) -> int:
        """Degree of the colour."""
        return min(self.options.sh_degree, int(step / (SH_RAISED_EVERY * self.options.steps)))

    def learning_rates(self, step: int) -> LearningRates:
        return learning_rates(step, self.options.steps, self.orbit.distance)

    def rate_factors(self, means: Float32) -> Float32 | None:
        """(N, 2) by which the rates of means and of log scales grow for Gaussians at `means`; None = not at all."""
        return None if self.options.steps < SURROUNDINGS_STEPS else rate_factors(means, self.orbit)

    def hidden_are_known(self, done: int) -> bool:
        """Whether the steps since the last densification before `done` used every view as a whole.

        Otherwise Gaussians that only the missed views show would count as hidden.
        """
        begin = max((step for step in self.densifications if step < done), default=0)
        seen = {self.order[step] for step in range(begin, done) if self.window(step) is None}
        return len(seen) == len(self.cameras)


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

    They follow whole epochs, so that every view counts. Short trainings, with room for fewer than
    FEWEST_DENSIFICATIONS of these, do not wait for the end of an epoch.
    """
    until = round(DENSIFY_UNTIL * steps)
    epochs = max(1, round(DENSIFY_EVERY * steps / n_views))
    first = math.ceil(DENSIFY_AFTER * steps / n_views) + epochs
    whole = range(first * n_views, until + 1, epochs * n_views)
    every = max(1, until // FEWEST_DENSIFICATIONS)
    return whole if len(whole) >= FEWEST_DENSIFICATIONS else range(every, until + 1, every)


def image_order(n_views: int, steps: int, seed: int) -> list[int]:
    """Index of the view of each step: all views once, in random order, then all again in another."""
    rng = open_stream(seed, "image order")
    epochs = [rng.permutation(n_views) for _ in range(math.ceil(steps / n_views))]
    order: list[int] = np.concatenate(epochs)[:steps].tolist()
    return order


def learning_rates(step: int, steps: int, radius_su: float) -> LearningRates:
    """Rates of step `step` of `steps`; that of the means grows with the scene.

    At 30,000 steps they start as those of Kerbl et al. 2023. A shorter run must cover the same way in fewer steps: all
    rates grow as the run gets shorter, down to SHORTEST_STEPS. The means' fall all the time, as in the paper, to a
    hundredth; the others, constant there, fall at the end. The exponents were fitted to runs of 1000 steps on 480 px
    and 3000 steps on 960 px images, where they gain 3 dB and 2 dB; that of view dependence to 2000 steps on 480 px.
    """
    progress = step / steps
    shortness = max(1.0, PAPER_STEPS / max(steps, SHORTEST_STEPS))
    settling = SETTLED ** max(0.0, (progress - SETTLING_FROM) / (1 - SETTLING_FROM))
    return LearningRates(
        means=1.6e-4 * radius_su * shortness**0.6 * 0.01**progress,
        quats=1e-3 * shortness**0.7 * settling,
        log_scales=5e-3 * shortness**0.7 * settling,
        opacity_logits=5e-2 * min(2.0, shortness) * settling,
        sh0=2.5e-3 * min(2.0, shortness) * settling,
        sh_rest=2.5e-3 / 20 * min(40.0, shortness) * settling,
    )


def rate_factors(means: Float32, orbit: Orbit) -> Float32:
    """(N, 2) by which the rates of means and of log scales grow around the plant, unlike in the paper.

    Gaussians there are larger and seen from farther. Within the plant region nothing changes; beyond it the factors
    grow with the distance of the (N, 3) `means` from its centre, up to their limits.
    """
    with np.errstate(all="ignore"):  # a mean may be anywhere, and the orbit of a single camera has no size
        # One axis at a time, as every step does this: sums over an array's last three numbers take three times as long.
        x, y, z = (axis - centre for axis, centre in zip(means.T, orbit.centre.astype(np.float32), strict=True))
        radii_beyond = np.sqrt(x * x + y * y + z * z) / np.float32(PLANT_REGION * orbit.distance) - 1
        longer = 1 + SURROUNDINGS_GROWTH * np.fmax(radii_beyond, 0)
    factors = np.empty((len(means), 2), np.float32)
    for column, most in enumerate((SURROUNDINGS_MEANS, SURROUNDINGS_LOG_SCALES)):
        np.minimum(longer, most, out=factors[:, column])
    return factors
