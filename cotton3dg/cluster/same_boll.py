# SPDX-License-Identifier: Apache-2.0
"""The probability that two parts are one boll: a logistic score of measures of the pair and of the plant's other parts.

`same_boll.toml` beside this file holds its terms; `make same-boll` fits them on simulated plants and writes the file.
Further measures were tried and add nothing (docs/notes/same_boll.md).
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

SCORE_FILE: Final = Path(__file__).with_name("same_boll.toml")
SUREST: Final = 1e-6
USUAL_JOINING: Final = 0.3
"""Share of joining parts of a plant before it is known."""


class PairMeasures(NamedTuple):
    """Two parts near each other."""

    sideways_cm: float
    """Horizontal distance between the middles of their lint: locks hang below their boll, a neighbour is beside it."""
    below_cm: float
    """Vertical distance between them."""
    two_middles: float
    """By how much the mean log likelihood of their votes grows when two middles explain them instead of one."""


@dataclass(frozen=True)
class Term:
    """One measure's part in the log odds."""

    name: str
    usual: float
    """The value that is evidence neither for one boll nor against it."""
    weight: float
    """Log odds of one boll for each unit above `usual`."""


@dataclass(frozen=True)
class Calibration:
    """True log odds as a linear function of the stated ones (Platt 1999)."""

    constant: float = 0.0
    slope: float = 1.0

    def probability(self, stated: float) -> float:
        """The calibrated probability for a stated one.

        1 stays 1: nothing was joined to such a boll and no part is near, so there is nothing to calibrate.
        """
        if stated == 1:
            return 1.0
        return logistic(self.constant + self.slope * log_odds(stated))


@dataclass(frozen=True)
class Score:
    """The fitted score: its log odds are a constant plus one summand for each term."""

    constant: float
    terms: tuple[Term, ...]
    joining: Term
    """`two_middles` times the share of the plant's parts that join others. Either most bolls of a plant come in parts
    or few do, and two middles are evidence of two bolls only where few do."""
    split_gain: float
    """A part is split if two middles raise the mean log likelihood of its votes by more than this."""
    one_boll: Calibration = Calibration()
    """Calibration of the probability that joined parts are one boll; pairs are not independent of each other."""

    def of_plant(self, joining: float) -> Score:
        """The score for a plant where this share of parts joins others.

        From some share on, two middles would be evidence of one boll; a larger share counts as this one.
        """
        constant, terms = self.constant - self.joining.weight * self.joining.usual, []
        for term in self.terms:
            more = min(self.joining.weight * joining, -term.weight) if term.name == "two_middles" else 0.0
            terms.append(replace(term, weight=term.weight + more))
            constant += more * term.usual
        return replace(self, constant=constant, terms=tuple(terms), joining=Term("joining", 0.0, 0.0))

    def probability(self, measures: PairMeasures) -> float:
        """Probability that both parts are one boll, 0..1, of the score for a plant (`of_plant`)."""
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
    joining, one_boll = Term("joining", **content["joining"]), Calibration(**content["one_boll"])
    return Score(content["constant"], terms, joining, content["split_gain"], one_boll)
