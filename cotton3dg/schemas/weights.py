# SPDX-License-Identifier: Apache-2.0
"""A fit of seed-cotton weight to measured traits, for plants that are not weighed."""

from __future__ import annotations

from dataclasses import dataclass

from .document import Document


@dataclass(frozen=True)
class Line(Document):
    """Weight = intercept + slope x predictor, by least squares over n plants."""

    REMEDY = "fit it again with `cotton3dg evaluate-weights`"

    predictor: str
    """Column of traits.csv."""
    slope: float
    """g per unit of the predictor."""
    intercept: float
    """g"""
    r2: float
    n: int
    mean: float
    """Mean of the predictor over the plants of the fit."""
    spread: float
    """Sum of its squared deviations from the mean."""
    residual_sd_g: float
    """With n - 2 degrees of freedom."""
    left_out_mape_pct: float
    """Mean absolute error of each plant predicted from the others, relative to its weight."""


@dataclass(frozen=True)
class WeightModel(Document):
    """weights.json: a line for each predictor."""

    REMEDY = Line.REMEDY

    lines: tuple[Line, ...]
    lint_pct: float | None = None
    """Share of lint in the seed cotton of the weighed plants; None where no table has it."""
