# SPDX-License-Identifier: Apache-2.0
"""Weight by volume: a line, its interval and what is blank, against figures computed by hand."""

import math

import numpy as np
import pytest

from cotton3dg.errors import BadInput
from cotton3dg.evaluation.weights import fit_line, fit_weights, weights_text, write_weights
from cotton3dg.schemas.weights import WeightModel
from cotton3dg.traits.weight import predict, predict_weight

VOLUMES = np.array([1.0, 2, 3, 4])
WEIGHTS = np.array([3.0, 4, 8, 9])
"""By hand: mean 2.5 and 6, slope 11 / 5 = 2.2, start 0.5, residuals 0.3, -0.9, 0.9, -0.3, their squares 1.8 of 26."""


def test_the_line_is_that_of_least_squares():
    line = fit_line("boll_volume_cm3", VOLUMES, WEIGHTS)
    assert (line.slope, line.intercept, line.n) == (pytest.approx(2.2), pytest.approx(0.5), 4)
    assert line.r2 == pytest.approx(1 - 1.8 / 26)
    assert (line.mean, line.spread) == (2.5, 5.0)
    assert line.residual_sd_g == pytest.approx(math.sqrt(1.8 / 2))
    # Each from the three others, by the normal equations.
    left_out = []
    for k in range(4):
        others = [i for i in range(4) if i != k]
        matrix = np.column_stack([np.ones(3), VOLUMES[others]])
        start, slope = np.linalg.solve(matrix.T @ matrix, matrix.T @ WEIGHTS[others])
        left_out.append(abs(start + slope * VOLUMES[k] - WEIGHTS[k]) / WEIGHTS[k])
    assert line.left_out_mape_pct == pytest.approx(100 * np.mean(left_out))


def test_the_interval_widens_away_from_the_plants_of_the_fit():
    """By hand: t = 4.3027 of two degrees of freedom; sqrt(1 + 1/4) at the mean, sqrt(1.25 + 6.25 / 5) at 5."""
    line = fit_line("boll_volume_cm3", VOLUMES, WEIGHTS)
    assert predict(line, 2.5) == (
        pytest.approx(6.0),
        pytest.approx(4.3027 * math.sqrt(0.9) * math.sqrt(1.25), rel=1e-4),
    )
    assert predict(line, 5.0) == (
        pytest.approx(11.5),
        pytest.approx(4.3027 * math.sqrt(0.9) * math.sqrt(2.5), rel=1e-4),
    )


def table(path, columns):
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_tables_are_fitted_saved_and_drawn(tmp_path):
    plants = ["a", "b", "c", "d", "unweighed"]
    measured = table(
        tmp_path / "batch.csv",
        {"plant_id": plants, "boll_volume_cm3": [1, 2, 3, 4, 5], "boll_count": [1, 2, "", 4, 9]},
    )
    truth = table(
        tmp_path / "weights.csv",
        {
            "plant_id": ["d", "c", "b", "a", "elsewhere"],
            "boll_weight_g": [9, 8, 4, 3, 7],
            "lint_pct": [40, 38, "", 42, 1],
        },
    )
    model, points = fit_weights(measured, truth)
    assert [line.predictor for line in model.lines] == ["boll_volume_cm3", "boll_count"]
    assert [line.n for line in model.lines] == [4, 3]
    assert model.lint_pct == pytest.approx(40)
    write_weights(tmp_path / "out", model, points)
    assert WeightModel.load(tmp_path / "out" / "weights.json") == model
    assert (tmp_path / "out" / "weights_boll_volume_cm3.png").stat().st_size > 5000
    assert "R2 = 0.931" in weights_text(model) and "lint: 40.0 %" in weights_text(model)


def test_a_plant_is_weighed_by_the_first_predictor_that_it_has(tmp_path):
    model = WeightModel(
        (fit_line("boll_volume_cm3", VOLUMES, WEIGHTS), fit_line("boll_count", VOLUMES, 2 * WEIGHTS)), 40
    )
    weight = predict_weight(model, {"boll_volume_cm3": 2.5, "boll_count": 2})
    assert weight.seed_cotton_g == pytest.approx(6.0) and weight.lint_g == pytest.approx(2.4)
    assert weight.low_g < 6 < weight.high_g and weight.high_g - 6 == pytest.approx(6 - weight.low_g)
    by_count = predict_weight(model, {"boll_volume_cm3": math.nan, "boll_count": 2.5})
    assert by_count.seed_cotton_g == pytest.approx(12.0)
    assert math.isnan(predict_weight(model, {"boll_volume_cm3": math.nan}).seed_cotton_g)
    assert math.isnan(predict_weight(WeightModel(model.lines), {"boll_volume_cm3": 1.0}).lint_g)


def test_too_few_weighed_plants_are_refused(tmp_path):
    measured = table(tmp_path / "batch.csv", {"plant_id": ["a", "b", "c"], "boll_volume_cm3": [1, 2, 3]})
    truth = table(tmp_path / "weights.csv", {"plant_id": ["a", "b"], "boll_weight_g": [1, 2]})
    with pytest.raises(BadInput, match="weigh more plants"):
        fit_weights(measured, truth)
