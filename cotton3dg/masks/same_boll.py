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


class PairMeasures(NamedTuple):
    """Two parts near each other."""

    apart_cm: float
    """Distance of the places that the votes of either meet in."""
    narrower_cm: float
    """Width of the lint of the narrower one, mean over all directions: a lock is narrower than a boll."""
    border: float
    """Mean probability of a border where views show them next to each other; NaN where none does."""


@dataclass(frozen=True)
class Term:
    """One measure's part in the log odds."""

    name: str
    usual: float
    """Where it speaks neither for nor against; an unknown measure is taken for this."""
    weight: float
    """Log odds of one boll for each unit beyond."""


@dataclass(frozen=True)
class Score:
    """Log odds that add up."""

    constant: float
    terms: tuple[Term, ...]

    def probability(self, measures: PairMeasures) -> float:
        """That both are one boll, 0..1."""
        odds = self.constant
        for term in self.terms:
            value = getattr(measures, term.name)
            odds += term.weight * (value - term.usual) if math.isfinite(value) else 0.0
        return 0.5 + 0.5 * math.tanh(0.5 * odds)


@cache
def read_score(path: Path = SCORE_FILE) -> Score:
    """The fitted score."""
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    return Score(content["constant"], tuple(Term(**term) for term in content["terms"]))
