# SPDX-License-Identifier: Apache-2.0
"""Seed-cotton weight of an unweighed plant by a line fitted to weighed ones (Cotton3DGaussians, Fig. 10 b)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from ..schemas.weights import Line, WeightModel

COVERAGE: Final = 0.95
"""Coverage of the prediction interval."""


@dataclass(frozen=True)
class Weight:
    """Weight of one plant, g; NaN where it cannot be predicted."""

    seed_cotton_g: float = math.nan
    low_g: float = math.nan
    high_g: float = math.nan
    lint_g: float = math.nan


def predict_weight(model: WeightModel, measured: Mapping[str, float]) -> Weight:
    """Predict by the first line of the model whose predictor was measured.

    Args:
        measured: column of traits.csv -> value, NaN where there is none.
    """
    for line in model.lines:
        value = measured.get(line.predictor, math.nan)
        if math.isfinite(value):
            weight_g, half_g = predict(line, value)
            share = math.nan if model.lint_pct is None else model.lint_pct / 100
            return Weight(weight_g, weight_g - half_g, weight_g + half_g, share * weight_g)
    return Weight()


def predict(line: Line, value: float) -> tuple[float, float]:
    """The weight on the line at a value of its predictor, and half of the prediction interval, g.

    A new plant lies off the fitted line by its own scatter and by the error of the line, which grows away from the
    middle of the plants that it was fitted to: t s sqrt(1 + 1/n + (x - mean)² / spread).
    """
    from scipy.stats import t

    off = math.sqrt(1 + 1 / line.n + (value - line.mean) ** 2 / line.spread)
    return line.intercept + line.slope * value, float(t.ppf(0.5 + COVERAGE / 2, line.n - 2)) * line.residual_sd_g * off
