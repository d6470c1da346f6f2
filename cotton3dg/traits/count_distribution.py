"""The distribution of the true number of bolls, given what was counted, and what miscounting does to their volume.

What was found for one boll is none, one or two (Poisson binomial with three outcomes, convolved exactly); bolls that no
image shows and the difference between halves of the images are added as further independent counts. The constants
marked "fitted" are those of tests/accuracy (docs/notes/stated_errors.md says which films, and how well).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from ..core.measurements import OFF_PLANT, BollTraits, is_counted
from ..core.scene import Float64
from .error_model import IS_TWO, UNROUND_FLAG, WELL_FILMED, Filming

TAIL: Final = 0.025
"""Probability beyond either end of a 95 % interval."""
TWO_OF_UNSURE: Final = 0.3
"""Share of the bolls that are not one boll which are two; the others are parts of one. Fitted (`make same-boll`)."""
MAY_BE_NONE: Final = frozenset((OFF_PLANT, "near_clamp", "too_small", "few_views", "disputed"))
"""Flags of bolls that may be none, which is then taken to be as likely as not."""
MAY_BE_TWO: Final = frozenset(("too_large", "large"))
"""Flags of bolls that may be two, which is then taken to be as likely as not."""
AS_LIKELY_AS_NOT: Final = 0.5
HULL_OF_TWO: Final = 0.2
"""Share of the convex hull of two equal balls that touch which is in neither."""
MISCOUNTED: Final = 0.03
"""Probability that a touching boll is lost, or counted twice. Fitted."""
BEHIND: Final = 0.03
"""Probability that others hide a boll all along a walk that lacks 280 degrees, so that it is not counted. Of two
simulated plants filmed so, one lost one of 16 bolls. Walks that lack 160 degrees lost none of 77."""


class Outcomes(NamedTuple):
    """Probabilities of what was found for one boll; they sum to 1."""

    none: float
    """It adds no boll: it is none, or a part of one that is counted already."""
    one: float
    two: float


class Moments(NamedTuple):
    """Mean and variance of a difference."""

    mean: float
    variance: float


class Possible(NamedTuple):
    """What was left out, and may be a boll."""

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


def distribute_count(
    bolls: Sequence[BollTraits],
    touching: Iterable[bool],
    halves: tuple[int, int] | None = None,
    filming: Filming = WELL_FILMED,
    left_out: Sequence[Possible] = (),
) -> CountDistribution | None:
    """The distribution of the true count; None without anything found, and for a plant that no image shows whole.

    Args:
        bolls: all that were found, also those that do not count.
        touching: of each, whether it may touch another.
        halves: counts by either half of the images. The mean squared difference of two counts with one variance is
            twice the variance; the count by all images is assumed to be no surer than that by half of them.
        left_out: what may be further bolls.
    """
    if not filming.whole or not (bolls or left_out):
        return None
    hidden = hidden_probability(filming)
    counts = np.ones(1)
    for boll, touches in zip(bolls, touching, strict=True):
        counts = np.convolve(counts, outcomes(boll, touches))
        if hidden and is_counted(boll.flags):
            counts = np.convolve(counts, [1 - hidden, hidden])
    for possible in left_out:
        counts = np.convolve(counts, [1 - possible.probability, possible.probability])
    if halves and halves[0] != halves[1]:
        noise = _whole_normal(abs(halves[0] - halves[1]) / math.sqrt(2))
        counts, zero = np.convolve(counts, noise), len(noise) // 2
        # There are no fewer bolls than none.
        counts = np.append(counts[: zero + 1].sum(), counts[zero + 1 :])
    return CountDistribution(counts)


def outcomes(boll: BollTraits, touches: bool) -> Outcomes:
    """What a boll may be, by its confidence, its flags and its neighbour.

    Two parts of one boll are both not one boll and only one of them is too many, so a part counts in half.
    """
    unsure = 1 - boll.confidence
    none, two = 0.5 * (1 - TWO_OF_UNSURE) * unsure, TWO_OF_UNSURE * unsure
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
    filming: Filming = WELL_FILMED,
    left_out: Sequence[Possible] = (),
) -> Moments:
    """What the true total volume has more than the sum of the counted bolls', because some of these may be none or two,
    others have no volume, hang on nothing, or are hidden. A part of a boll has its volume in the sum.

    Args:
        bolls, touching, filming, left_out: as for `distribute_count`.
    """
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
            moments.append(_with_probability(outcomes(boll, touches).two, -HULL_OF_TWO * boll.volume_cm3))
    moments += [_with_probability(hidden_probability(filming), mean_cm3, variance)] * len(counted)
    moments += [_with_probability(possible.probability, possible.volume_cm3) for possible in left_out]
    return Moments(sum(one.mean for one in moments), sum(one.variance for one in moments))


def _with_probability(probability: float, mean: float, variance: float = 0.0) -> Moments:
    """Moments of a variable that is 0 but with some probability."""
    return Moments(probability * mean, probability * variance + probability * (1 - probability) * mean**2)


def hidden_probability(filming: Filming) -> float:
    """Probability of a further boll, for each that was counted, that no image shows."""
    return BEHIND * max(filming.gap_deg - 180, 0.0) / 100


def _whole_normal(deviation: float) -> Float64:
    """(2 n + 1,) probabilities of a normal variable of mean 0, rounded to -n ... n."""
    last = math.ceil(5 * deviation)
    ends = (np.arange(-last, last + 2) - 0.5) / (deviation * math.sqrt(2))
    inside = np.diff([math.erf(end) for end in ends]) / 2
    return np.asarray(inside / inside.sum(), np.float64)
