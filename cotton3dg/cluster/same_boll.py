# SPDX-License-Identifier: Apache-2.0
"""The probability that two parts are one boll: a logistic score of the measures of the pair, and what splits a part.

`same_boll.toml` beside this file holds its terms; `make same-boll` fits them on simulated plants and writes the file.
Further measures were tried and add nothing (docs/notes/same_boll.md).
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

SCORE_FILE: Final = Path(__file__).with_name("same_boll.toml")
SUREST: Final = 1e-6


class PairMeasures(NamedTuple):
    """Two parts near each other."""

    apart_cm: float
    """Distance between the places where the votes of each part meet."""
    joined_cm: float
    """Width of the lint of both together, mean over all directions."""
    two_middles: float
    """Gain of a vote's mean log likelihood when two middles explain the votes of both, instead of one."""


@dataclass(frozen=True)
class Term:
    """One measure's part in the log odds."""

    name: str
    usual: float
    """The value that is evidence neither for one boll nor against it."""
    weight: float
    """Log odds of one boll for each unit beyond."""


@dataclass(frozen=True)
class Calibration:
    """True log odds as a linear function of the stated ones (Platt 1999)."""

    constant: float = 0.0
    slope: float = 1.0

    def probability(self, stated: float) -> float:
        """The calibrated probability for a stated one. A boll states 1 if nothing was joined to it and no other part is
        near: nothing was measured, so there is nothing to calibrate."""
        if stated == 1:
            return 1.0
        return logistic(self.constant + self.slope * log_odds(stated))


@dataclass(frozen=True)
class Score:
    """Log odds that add up, for the parts that a split leaves."""

    constant: float
    terms: tuple[Term, ...]
    split_gain: float
    """Gain of the mean log likelihood of a vote by two middles instead of one, from which a part is split."""
    one_boll: Calibration = Calibration()
    """Calibration of the probability that joined parts are one boll, as pairs are not independent of each other."""

    def probability(self, measures: PairMeasures) -> float:
        """Probability that both parts are one boll, 0..1."""
        odds = self.constant
        for term in self.terms:
            odds += term.weight * (getattr(measures, term.name) - term.usual)
        return logistic(odds)


def logistic(odds: float) -> float:
    """Probability of log odds."""
    return 0.5 + 0.5 * math.tanh(0.5 * odds)


def log_odds(probability: float) -> float:
    """Log odds of a probability, kept at least `SUREST` away from 0 and 1."""
    bounded = min(max(probability, SUREST), 1 - SUREST)
    return math.log(bounded / (1 - bounded))


@cache
def read_score(path: Path = SCORE_FILE) -> Score:
    """The fitted score."""
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    terms = tuple(Term(**term) for term in content["terms"])
    return Score(content["constant"], terms, content["split_gain"], Calibration(**content["one_boll"]))
