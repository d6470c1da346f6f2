# SPDX-License-Identifier: Apache-2.0
"""Seed-cotton weight from boll volume and from boll count, fitted to weighed plants (Cotton3DGaussians, Fig. 10 b)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64
from ..errors import BadInput
from ..io.saving import explain_disk_errors
from ..io.scatter import write_fit
from ..schemas.weights import Line, WeightModel
from ..traits.weight import predict
from .tables import VOLUME, WEIGHT, predict_left_out, read_by_plant, score

PREDICTORS: Final = (VOLUME, "boll_count")
"""The volume comes first: for a plant without one, the count predicts the weight."""
LINT_PCT: Final = "lint_pct"
LEAST_PLANTS: Final = 3
"""A line through two plants has no scatter that would give an interval."""


def fit_line(predictor: str, values: NDArray[Any], weights_g: NDArray[Any]) -> Line:
    """The straight line of least squares through N >= 3 plants with different values."""
    x, y = np.asarray(values, np.float64), np.asarray(weights_g, np.float64)
    slope, intercept = (float(value) for value in np.polyfit(x, y, 1))
    residuals = y - intercept - slope * x
    spread_y = float(((y - y.mean()) ** 2).sum())
    squares = float((residuals**2).sum())
    return Line(
        predictor,
        slope,
        intercept,
        r2=1 - squares / spread_y if spread_y > 0 else math.nan,
        n=len(x),
        mean=float(x.mean()),
        spread=float(((x - x.mean()) ** 2).sum()),
        residual_sd_g=math.sqrt(squares / (len(x) - 2)),
        left_out_mape_pct=score(WEIGHT, y, predict_left_out(x, y)).mape_pct,
    )


def fit_weights(measured_csv: Path, truth_csv: Path) -> tuple[WeightModel, dict[str, tuple[Float64, Float64]]]:
    """A line for each predictor, and predictor -> its values and the weights, g, of the fitted plants.

    Args:
        measured_csv: batch.csv or another table with the columns of traits.csv.
        truth_csv: with plant_id, boll_weight_g and perhaps lint_pct; may be the same file.
    Raises:
        MissingInput: a table does not exist. BadInput: too few weighed plants were measured.
    """
    measured, truth = read_by_plant(measured_csv), read_by_plant(truth_csv)
    plants = [plant for plant in truth.places if plant in measured.places]
    weights = truth.numbers(WEIGHT, plants)
    lines, points = [], {}
    for predictor in PREDICTORS:
        values = measured.numbers(predictor, plants)
        both = np.isfinite(values) & np.isfinite(weights)
        if both.sum() >= LEAST_PLANTS and np.ptp(values[both]) > 0:
            lines.append(fit_line(predictor, values[both], weights[both]))
            points[predictor] = (values[both], weights[both])
    if not lines:
        raise BadInput(
            f"{truth_csv.name} has a {WEIGHT} of fewer than {LEAST_PLANTS} plants that {measured_csv.name} measured "
            f"differently; weigh more plants"
        )
    shares = truth.numbers(LINT_PCT, plants)
    shares = shares[np.isfinite(shares)]
    return WeightModel(tuple(lines), float(shares.mean()) if len(shares) else None), points


def write_weights(folder: Path, model: WeightModel, points: dict[str, tuple[Float64, Float64]]) -> None:
    """Save weights.json, and a weights_<predictor>.png with the line and its prediction interval."""
    with explain_disk_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        model.save(folder / "weights.json")
        for line in model.lines:
            values, weights = points[line.predictor]
            along = np.linspace(values.min(), values.max(), 50)
            predicted = np.array([predict(line, float(value)) for value in along])
            title = f"{WEIGHT} by {line.predictor}"
            band = along, predicted[:, 0], predicted[:, 1]
            write_fit(
                folder / f"weights_{line.predictor}.png", title, line.predictor, values, weights, band, _notes(line)
            )


def weights_text(model: WeightModel) -> str:
    """A line of text for each line of the model."""
    lines = [f"{WEIGHT} by {line.predictor}: " + ", ".join(_notes(line)) for line in model.lines]
    return "\n".join([*lines, *([f"lint: {model.lint_pct:.1f} % of it"] if model.lint_pct is not None else [])])


def _notes(line: Line) -> list[str]:
    return [
        f"y = {line.intercept:.3g} + {line.slope:.4g} x",
        f"n = {line.n}",
        f"R2 = {line.r2:.3f}",
        f"each from the others: {line.left_out_mape_pct:.1f} %",
    ]
