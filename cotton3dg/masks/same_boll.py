"""The probability that two parts are one boll: a logistic score of what was measured of both.

`same_boll.toml` beside this file holds its terms; `make same-boll` fits them on simulated plants and writes it. What is
not here was tried and adds nothing (docs/notes/same_boll.md).
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

SCORE_FILE: Final = Path(__file__).with_name("same_boll.toml")
SUREST: Final = 1e-3


class PairMeasures(NamedTuple):
    """Two parts near each other."""

    apart_cm: float
    """Distance of the places that the votes of either meet in."""
    joined_cm: float
    """Width of the lint of both together, mean over all directions."""
    two_middles: float
    """Log likelihood of a vote, in the mean, by which two middles explain the votes of both better than one."""


@dataclass(frozen=True)
class Term:
    """One measure's part in the log odds."""

    name: str
    usual: float
    """Where it speaks neither for nor against."""
    weight: float
    """Log odds of one boll for each unit beyond."""


@dataclass(frozen=True)
class Calibration:
    """Log odds of what comes true, by those that were stated (Platt 1999)."""

    constant: float = 0.0
    slope: float = 1.0

    def probability(self, stated: float) -> float:
        """Of what has a stated probability."""
        return logistic(self.constant + self.slope * log_odds(stated))


@dataclass(frozen=True)
class Score:
    """Log odds that add up."""

    constant: float
    terms: tuple[Term, ...]
    one_boll: Calibration = Calibration()
    """Of the probability that what was joined is one boll: pairs are not independent of each other."""

    def probability(self, measures: PairMeasures) -> float:
        """That both are one boll, 0..1."""
        odds = self.constant
        for term in self.terms:
            odds += term.weight * (getattr(measures, term.name) - term.usual)
        return logistic(odds)


def logistic(odds: float) -> float:
    """Probability of log odds."""
    return 0.5 + 0.5 * math.tanh(0.5 * odds)


def log_odds(probability: float) -> float:
    """Of a probability, which is taken to be neither nearer to 0 nor to 1 than `SUREST`."""
    bounded = min(max(probability, SUREST), 1 - SUREST)
    return math.log(bounded / (1 - bounded))


@cache
def read_score(path: Path = SCORE_FILE) -> Score:
    """The fitted score."""
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    terms = tuple(Term(**term) for term in content["terms"])
    return Score(content["constant"], terms, Calibration(**content["one_boll"]))
