# SPDX-License-Identifier: Apache-2.0
"""The distribution of the true number of bolls, given the counted ones, and the effect of a wrong count on the volume.

Each counted boll may be none, one or two in truth (a Poisson binomial distribution with three outcomes, convolved
exactly). The bolls of a plant err alike: where their kind is new to the network, all doubtful ones are two, or all are
parts of one, and all confidences are too high, or all too low. The distribution is therefore a mixture over such common
states: a logistic normal model, integrated by Gauss-Hermite quadrature. Two further counts are independent: the bolls
that no image shows, and the difference between the counts by two halves of the images. The constants marked "fitted"
are those of tests/accuracy (docs/notes/stated_errors.md lists the films and the results).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from ..core.measurements import OFF_PLANT, BollTraits, is_counted
from ..core.scene import Float64
from .error_model import IS_TWO, UNROUND_FLAG, USUAL_CONDITIONS, Conditions

TAIL: Final = 0.025
"""Probability beyond either end of a 95 % interval."""
COMMON_DEVIATION: Final = 0.5
"""Standard deviation between plants of the log odds of one boll. It is 0.9 for kinds of bolls that the score was not
fitted to (`make same-boll`), and the score knows the kinds of most plants (docs/notes/stated_errors.md)."""
NODES: Final = 5
"""Number of nodes of the integral over plants."""
MAY_BE_NONE: Final = frozenset((OFF_PLANT, "near_clamp", "too_small", "few_views", "disputed"))
"""Flags of bolls that may be none; the probability of that is then one half."""
MAY_BE_TWO: Final = frozenset(("too_large", "large"))
"""Flags of bolls that may be two; the probability of that is then one half."""
AS_LIKELY_AS_NOT: Final = 0.5
HULL_OF_TWO: Final = 0.2
"""Share of the convex hull of two equal touching balls that neither ball fills."""
MISCOUNTED: Final = 0.03
"""Probability that a touching boll is lost, or counted twice. Fitted."""
BEHIND: Final = 0.03
"""Probability that other bolls hide a boll in all images of a walk that lacks 280 degrees. Of two simulated plants
filmed like this, one lost one of 16 bolls. Walks that lack 160 degrees lost none of 77."""


class Outcomes(NamedTuple):
    """Probabilities of what one counted boll is in truth; they sum to 1."""

    none: float
    """It adds nothing to the count: it is not a boll, or it is a part of another counted boll."""
    one: float
    two: float


class Moments(NamedTuple):
    """Mean and variance of a difference."""

    mean: float
    variance: float


class Possible(NamedTuple):
    """Something that was not counted, and may be a boll."""

    probability: float
    volume_cm3: float


@dataclass(frozen=True)
class CountDistribution:
    """The true number of bolls, as a probability for each number."""

    probabilities: Float64
    """(n + 1,) of 0, 1, ... n bolls."""

    def error_about(self, count: int) -> float:
        """Root mean square difference from a count."""
        away = np.arange(len(self.probabilities)) - count
        return float(np.sqrt((self.probabilities * away**2).sum()))

    def interval(self, count: int) -> tuple[int, int]:
        """Ends of the 95 % interval: quantiles, and the count itself."""
        below = self.probabilities.cumsum()
        low = int(np.searchsorted(below, TAIL, side="right"))
        high = int(np.searchsorted(below, 1 - TAIL, side="left"))
        return min(low, count), max(high, count)


class Common(NamedTuple):
    """A state that the bolls of a plant may share."""

    weight: float
    """Probability."""
    shift: float
    """Of the log odds of one boll."""
    are_two: bool
    """Whether those that are not one boll are two bolls; else they are parts of one."""


def common_states(deviation: float) -> tuple[Common, ...]:
    """The states, as nodes of the integral over plants.

    Args:
        deviation: of the log odds.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    weights /= 2 * weights.sum()
    return tuple(
        Common(weight, deviation * node, are_two)
        for node, weight in zip(nodes.tolist(), weights.tolist(), strict=True)
        for are_two in (False, True)
    )


COMMON: Final = common_states(COMMON_DEVIATION)


def distribute_count(
    bolls: Sequence[BollTraits],
    touching: Iterable[bool],
    halves: tuple[int, int] | None = None,
    conditions: Conditions = USUAL_CONDITIONS,
    left_out: Sequence[Possible] = (),
    common: Sequence[Common] = COMMON,
) -> CountDistribution | None:
    """The distribution of the true count; None if nothing was found, or if no image shows the plant whole.

    Args:
        bolls: all that were found, also those that do not count.
        touching: of each, whether it may touch another.
        halves: counts by either half of the images. The mean squared difference of two counts with one variance is
            twice the variance; the count by all images is assumed to be no surer than that by half of them.
        left_out: what may be further bolls. common: states that the bolls share.
    """
    if not conditions.whole or not (bolls or left_out):
        return None
    hidden, counts = hidden_probability(conditions), np.zeros(2 * len(bolls) + 1)
    touches = list(touching)
    for state in common:
        one_by_one = np.ones(1)
        for boll, touch in zip(bolls, touches, strict=True):
            one_by_one = np.convolve(one_by_one, outcomes(boll, touch, state))
        counts += state.weight * one_by_one
    for _ in range(sum(is_counted(boll.flags) for boll in bolls) if hidden else 0):
        counts = np.convolve(counts, [1 - hidden, hidden])
    for possible in left_out:
        counts = np.convolve(counts, [1 - possible.probability, possible.probability])
    if halves and halves[0] != halves[1]:
        noise = _whole_normal(abs(halves[0] - halves[1]) / math.sqrt(2))
        counts, zero = np.convolve(counts, noise), len(noise) // 2
        # There are no fewer bolls than none.
        counts = np.append(counts[: zero + 1].sum(), counts[zero + 1 :])
    return CountDistribution(counts)


def outcomes(boll: BollTraits, touches: bool, common: Common) -> Outcomes:
    """What a boll may be, by its confidence, its flags and its neighbour.

    Where two parts of one boll are counted, the count is too high by one, so each part counts one half.
    """
    # Odds, not log odds, as a boll may be certain.
    unsure = (1 - boll.confidence) / (1 - boll.confidence + boll.confidence * math.exp(common.shift))
    none, two = (0.0, unsure) if common.are_two else (0.5 * unsure, 0.0)
    if touches:
        none, two = max(none, MISCOUNTED / 2), max(two, MISCOUNTED / 2)
    if UNROUND_FLAG in boll.flags:
        two = max(two, IS_TWO)
    if not MAY_BE_TWO.isdisjoint(boll.flags):
        two = max(two, AS_LIKELY_AS_NOT)
    if not MAY_BE_NONE.isdisjoint(boll.flags):
        none = max(none, AS_LIKELY_AS_NOT)
    if not is_counted(boll.flags):
        two = 0.0
    total = max(none + two, 1.0)
    return Outcomes(none / total, 1 - (none + two) / total, two / total)


def miscounted_volume(
    bolls: Sequence[BollTraits],
    touching: Iterable[bool],
    conditions: Conditions = USUAL_CONDITIONS,
    left_out: Sequence[Possible] = (),
    common: Sequence[Common] = COMMON,
) -> Moments:
    """The difference of the true total volume from the sum over the counted bolls.

    Counted bolls may be none or two, or have no volume; others hang on nothing or are hidden. A part of a boll adds
    nothing to the difference, because its volume is in the sum.

    Args:
        bolls, touching, conditions, left_out, common: as for `distribute_count`.
    """
    touches = list(touching)
    states = [(state.weight, _miscounted(bolls, touches, conditions, left_out, state)) for state in common]
    mean = sum(weight * one.mean for weight, one in states)
    return Moments(mean, sum(weight * (one.variance + (one.mean - mean) ** 2) for weight, one in states))


def _miscounted(
    bolls: Sequence[BollTraits],
    touching: Sequence[bool],
    conditions: Conditions,
    left_out: Sequence[Possible],
    common: Common,
) -> Moments:
    counted = [boll for boll in bolls if is_counted(boll.flags)]
    known = np.array([boll.volume_cm3 for boll in counted if np.isfinite(boll.volume_cm3)])
    if not len(known):
        return Moments(0.0, 0.0)
    mean_cm3, variance = float(known.mean()), float(known.var())
    moments = []
    for boll, touches in zip(bolls, touching, strict=True):
        present = 1 - AS_LIKELY_AS_NOT * (not MAY_BE_NONE.isdisjoint(boll.flags))
        if not np.isfinite(boll.volume_cm3):
            moments.append(_with_probability(present, mean_cm3, variance))
        elif not is_counted(boll.flags):
            moments.append(_with_probability(present, boll.volume_cm3))
        else:
            moments.append(_with_probability(1 - present, -boll.volume_cm3))
            moments.append(_with_probability(outcomes(boll, touches, common).two, -HULL_OF_TWO * boll.volume_cm3))
    moments += [_with_probability(hidden_probability(conditions), mean_cm3, variance)] * len(counted)
    moments += [_with_probability(possible.probability, possible.volume_cm3) for possible in left_out]
    return Moments(sum(one.mean for one in moments), sum(one.variance for one in moments))


def _with_probability(probability: float, mean: float, variance: float = 0.0) -> Moments:
    """Moments of a variable that differs from 0 only with some probability."""
    return Moments(probability * mean, probability * variance + probability * (1 - probability) * mean**2)


def hidden_probability(conditions: Conditions) -> float:
    """Expected number of bolls that no image shows, for each counted boll."""
    return BEHIND * max(conditions.gap_deg - 180, 0.0) / 100


def _whole_normal(deviation: float) -> Float64:
    """(2 n + 1,) probabilities of a normal variable of mean 0, rounded to -n ... n."""
    last = math.ceil(5 * deviation)
    ends = (np.arange(-last, last + 2) - 0.5) / (deviation * math.sqrt(2))
    inside = np.diff([math.erf(end) for end in ends]) / 2
    return np.asarray(inside / inside.sum(), np.float64)
