"""A table of many plants beside a table of the truth: error measures and a scatter plot of each trait.

Plants are matched by plant_id and traits by the header: whatever column both tables have as numbers is compared. A
column boll_weight_g of the truth is besides predicted from the measured boll volume (seed paper Cotton3DGaussians).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.columns import Column
from ..errors import BadInput, MissingInput
from ..files.saving import explain_disk_errors
from ..files.scatter import write_scatter
from ..files.tables import csv_text, parse_number, read_rows

ID = "plant_id"
WEIGHT = "boll_weight_g"
VOLUME = "boll_volume_cm3"
NOT_TRAITS = (ID, "version", "scale_source", "qc_flags", "seconds", "n_frames", "registered_pct", "psnr_db")


@dataclass(frozen=True)
class TraitScore:
    """How a trait agrees with the truth over all plants that have both; NaN where it is not defined."""

    trait: str
    n: int
    rmse: float
    mae: float
    mape_pct: float
    """Mean of the absolute errors relative to the truth, of plants whose truth is not 0."""
    bias: float
    """Mean of measured minus true."""
    r2: float
    """Squared correlation, that of a straight line through the points."""
    r2_identity: float
    """That of the 1:1 line: 1 - (squared errors) / (variance of the truth); below 0 if the mean is a better guess."""


@dataclass(frozen=True)
class TableEvaluation:
    """What two tables say together."""

    scores: list[TraitScore]
    pairs: dict[str, tuple[NDArray, NDArray]]
    """Trait -> true and measured values of the plants that have both."""
    missing: tuple[str, ...]
    """Plants of the truth that were not measured."""
    extra: tuple[str, ...]
    """Measured plants without truth."""
    repeated: tuple[str, ...]
    """Plants that a table has twice; they are left out."""
    blank: dict[str, tuple[str, ...]]
    """Trait -> plants in which it was not measured."""
    weight_error_pct: float
    """Mean over plants of the absolute error of the boll weight, predicted from the other plants; NaN if unknown."""


def score(trait: str, true: NDArray, measured: NDArray) -> TraitScore:
    """Error measures of N plants."""
    true, measured = np.asarray(true, np.float64), np.asarray(measured, np.float64)
    error = measured - true
    relative = np.abs(error[true != 0] / true[true != 0])
    spread = float(((true - true.mean()) ** 2).sum()) if len(true) else 0.0
    varies = len(true) > 1 and spread > 0 and np.ptp(measured) > 0
    return TraitScore(
        trait,
        len(true),
        rmse=float(np.sqrt(np.mean(error**2))) if len(true) else math.nan,
        mae=float(np.abs(error).mean()) if len(true) else math.nan,
        mape_pct=float(100 * relative.mean()) if len(relative) else math.nan,
        bias=float(error.mean()) if len(true) else math.nan,
        r2=float(np.corrcoef(true, measured)[0, 1] ** 2) if varies else math.nan,
        r2_identity=1 - float((error**2).sum()) / spread if spread > 0 else math.nan,
    )


def predict_left_out(volumes: NDArray, weights: NDArray) -> NDArray:
    """(N,) weight of each plant by the straight line through the volumes and weights of all others; NaN for N < 3."""
    volumes, weights = np.asarray(volumes, np.float64), np.asarray(weights, np.float64)
    predictions = np.full(len(volumes), np.nan)
    for left_out in range(len(volumes)):
        others = np.arange(len(volumes)) != left_out
        if others.sum() >= 2 and np.ptp(volumes[others]) > 0:
            slope, start = np.polyfit(volumes[others], weights[others], 1)
            predictions[left_out] = start + slope * volumes[left_out]
    return predictions


def evaluate_tables(measured_csv: Path, truth_csv: Path) -> TableEvaluation:
    """Compare two tables.

    Raises:
        MissingInput: a table is not there.
        BadInput: a table has no plant_id, the tables have no plant or no trait in common.
    """
    measured, measured_twice = read_by_plant(measured_csv)
    truth, truth_twice = read_by_plant(truth_csv)
    repeated = tuple(sorted({*measured_twice, *truth_twice}))
    plants = [plant for plant in truth if plant in measured and plant not in repeated]
    if not plants:
        raise BadInput(
            f"{measured_csv.name} and {truth_csv.name} have no plant in common; check their plant_id columns"
        )
    traits = [name for name in _columns(truth) if name in _columns(measured) and name not in NOT_TRAITS]
    scores, pairs, blank = [], {}, {}
    for trait in traits:
        values = np.array([[parse_finite(table[plant][trait]) for table in (truth, measured)] for plant in plants])
        true, found = values.T
        if not np.isfinite(true).any():
            continue
        both = np.isfinite(values).all(axis=1)
        scores.append(score(trait, true[both], found[both]))
        pairs[trait] = (true[both], found[both])
        lacking = np.isfinite(true) & ~np.isfinite(found)
        if lacking.any():
            blank[trait] = tuple(plant for plant, lacks in zip(plants, lacking, strict=True) if lacks)
    weight_error_pct = math.nan
    if WEIGHT in _columns(truth) and VOLUME in _columns(measured):
        values = np.array([[parse_finite(truth[p][WEIGHT]), parse_finite(measured[p][VOLUME])] for p in plants])
        weights, volumes = values[np.isfinite(values).all(axis=1)].T
        predicted = predict_left_out(volumes, weights)
        if np.isfinite(predicted).any():
            scores.append(score(WEIGHT, weights, predicted))
            pairs[WEIGHT] = (weights, predicted)
            weight_error_pct = scores[-1].mape_pct
    if not scores:
        raise BadInput(f"{truth_csv.name} has no trait of {measured_csv.name}; name its columns as in traits.csv")
    return TableEvaluation(
        scores,
        pairs,
        missing=tuple(plant for plant in truth if plant not in measured),
        extra=tuple(plant for plant in measured if plant not in truth),
        repeated=repeated,
        blank=blank,
        weight_error_pct=weight_error_pct,
    )


SCORES = (
    Column("trait", "", "column of traits.csv; boll_weight_g: predicted from boll_volume_cm3, each plant left out"),
    Column("n", "1", "plants that have both values"),
    Column("rmse", "", "root mean square error, in the trait's unit", 4),
    Column("mae", "", "mean absolute error, in the trait's unit", 4),
    Column("mape_pct", "%", "mean absolute error relative to the truth", 2),
    Column("bias", "", "mean of measured minus true, in the trait's unit", 4),
    Column("r2", "1", "squared correlation", 4),
    Column("r2_identity", "1", "coefficient of determination of the 1:1 line", 4),
)


def write_evaluation(folder: Path, evaluation: TableEvaluation) -> None:
    """Save evaluation.csv and a scatter_<trait>.png for each trait with a value."""
    with explain_disk_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        text = csv_text(SCORES, [vars(item) for item in evaluation.scores])
        (folder / "evaluation.csv").write_bytes(text.encode("utf-8"))
        for item in evaluation.scores:
            true, measured = evaluation.pairs[item.trait]
            if len(true):
                notes = [
                    f"n = {item.n}",
                    f"RMSE = {item.rmse:.3g}",
                    f"MAPE = {item.mape_pct:.2f} %",
                    f"bias = {item.bias:+.3g}",
                    f"R2 = {item.r2:.3f}",
                ]
                write_scatter(folder / f"scatter_{item.trait}.png", item.trait, true, measured, notes)


def evaluation_text(evaluation: TableEvaluation) -> str:
    """The scores, a trait a line, and which plants could not be compared."""
    lines = [f"{'trait':<26}{'n':>4}{'RMSE':>10}{'MAE':>10}{'MAPE %':>9}{'bias':>10}{'R2':>8}{'R2 1:1':>9}"]
    lines += [
        f"{s.trait:<26}{s.n:>4}{s.rmse:>10.3f}{s.mae:>10.3f}{s.mape_pct:>9.2f}{s.bias:>+10.3f}{s.r2:>8.3f}"
        f"{s.r2_identity:>9.3f}"
        for s in evaluation.scores
    ]
    if math.isfinite(evaluation.weight_error_pct):
        lines.append(f"boll weight, each plant predicted from the others: {evaluation.weight_error_pct:.1f} % a plant")
    told = {
        "not measured (in the truth only)": evaluation.missing,
        "without truth (measured only)": evaluation.extra,
        "left out, twice in a table": evaluation.repeated,
    } | {f"{trait} is blank": plants for trait, plants in evaluation.blank.items()}
    lines += [f"{what}: {', '.join(plants)}" for what, plants in told.items() if plants]
    return "\n".join(lines)


def read_by_plant(path: Path) -> tuple[dict[str, dict[str, str]], list[str]]:
    """Rows by plant, and the plants that have several."""
    if not path.is_file():
        raise MissingInput(f"{path.name} is missing; give a table with a column {ID}")
    rows = read_rows(path)
    if not rows or ID not in rows[0]:
        raise BadInput(f"{path.name} has no column {ID}; name the plants in one")
    names = [row[ID].strip() for row in rows]
    twice = [name for name, count in Counter(names).items() if count > 1]
    return {name: row for name, row in zip(names, rows, strict=True) if name}, twice


def _columns(table: dict[str, dict[str, str]]) -> Sequence[str]:
    return [name for name in next(iter(table.values()), {}) if name]


def parse_finite(cell: str) -> float:
    """A cell's number; NaN also of one that is not finite."""
    value = parse_number(cell)
    return value if math.isfinite(value) else math.nan
