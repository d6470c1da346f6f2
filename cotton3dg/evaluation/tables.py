# SPDX-License-Identifier: Apache-2.0
"""A table of many plants, or of their bolls, against a table of the truth: error measures and a plot of each trait.

Plants are matched by plant_id, bolls of one plant by their places or else by boll_id, and traits by the header:
every column with numbers in both tables is compared. The module also predicts a column boll_weight_g of the truth from
the measured boll volume of a plant (seed paper Cotton3DGaussians).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.columns import Column
from ..core.scene import Float64
from ..errors import BadInput, MissingInput
from ..io.saving import explain_disk_errors
from ..io.scatter import write_scatter
from ..io.spreadsheet import Table, read_table
from ..io.tables import BOLLS, TRAITS, csv_text
from .match import MATCH_DISTANCE_CM, match_bolls

ID: Final = "plant_id"
BOLL: Final = "boll_id"
PLACE: Final = ("x_cm", "y_cm", "z_cm")
"""Centre of a boll in the plant's frame."""
WEIGHT: Final = "boll_weight_g"
VOLUME: Final = "boll_volume_cm3"
NOT_TRAITS: Final = (
    ID, BOLL, *PLACE, "version", "scale_source", "qc_flags", "seconds", "n_frames", "registered_pct", "psnr_db",
    "n_gaussians", "n_views", "confidence",
)  # fmt: skip
MEASURED: Final = {WEIGHT, *(column.name for column in (*TRAITS, *BOLLS) if column.unit)}
"""Columns that hold numbers in any table."""


@dataclass(frozen=True)
class TraitScore:
    """How a trait agrees with the truth over all plants that have both; NaN if it is not defined."""

    trait: str
    n: int
    rmse: float
    mae: float
    mape_pct: float
    """Mean of the absolute errors relative to the truth, of plants whose truth is not 0."""
    bias: float
    """Mean of measured minus true."""
    r2: float
    """Squared correlation: R² of a straight line through the points."""
    r2_identity: float
    """R² of the 1:1 line: 1 - (squared errors) / (variance of the truth); below 0 if the mean is a better guess."""


@dataclass(frozen=True)
class TableEvaluation:
    """The comparison of two tables."""

    scores: list[TraitScore]
    pairs: dict[str, tuple[Float64, Float64]]
    """Trait -> true and measured values of the plants that have both."""
    missing: tuple[str, ...]
    """Plants of the truth that were not measured."""
    extra: tuple[str, ...]
    """Measured plants without truth."""
    repeated: tuple[str, ...]
    """Plants that occur twice in a table; they are left out."""
    blank: dict[str, tuple[str, ...]]
    """Trait -> plants in which it was not measured."""
    weight_error_pct: float
    """Mean over plants of the absolute error of the boll weight, predicted from the other plants; NaN if unknown."""


def score(trait: str, true: NDArray[Any], measured: NDArray[Any]) -> TraitScore:
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


def predict_left_out(volumes: NDArray[Any], weights: NDArray[Any]) -> Float64:
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
        MissingInput: a table does not exist.
        BadInput: a table has no plant_id, or the tables have no plant or no trait in common.
    """
    measured, truth = read_by_plant(measured_csv), read_by_plant(truth_csv)
    repeated = tuple(sorted({*measured.twice, *truth.twice}))
    plants = [plant for plant in truth.places if plant in measured.places and plant not in repeated]
    if not plants:
        raise _nothing_common(measured_csv, truth_csv)
    places = {plant: (truth.places[plant], measured.places[plant]) for plant in plants}
    scores, pairs, blank = _compare(truth.table, measured.table, places)
    weight_error_pct = math.nan
    values = np.stack([truth.numbers(WEIGHT, plants), measured.numbers(VOLUME, plants)], 1)
    weights, volumes = values[np.isfinite(values).all(axis=1)].T
    predicted = predict_left_out(volumes, weights)
    if np.isfinite(predicted).any():
        scores.append(score(WEIGHT, weights, predicted))
        pairs[WEIGHT] = (weights, predicted)
        weight_error_pct = scores[-1].mape_pct
    if not scores:
        raise _no_trait(measured_csv, truth_csv)
    return TableEvaluation(
        scores,
        pairs,
        missing=tuple(plant for plant in truth.places if plant not in measured.places),
        extra=tuple(plant for plant in measured.places if plant not in truth.places),
        repeated=repeated,
        blank=blank,
        weight_error_pct=weight_error_pct,
    )


def evaluate_boll_tables(measured_csv: Path, truth_csv: Path) -> TableEvaluation:
    """Compare two tables of bolls; plants that only one of them has are left out without a remark.

    Where both tables have a plant's places (`PLACE`), its bolls are matched one to one by them, no farther apart than
    `MATCH_DISTANCE_CM`; else by boll_id. Bolls are named plant/boll.

    Raises:
        MissingInput: a table does not exist.
        BadInput: a table names no plants or bolls, or the tables have no boll or no trait in common.
    """
    (measured, found_of), (truth, true_of) = (_read_by_boll(path) for path in (measured_csv, truth_csv))
    found_cm, true_cm = _centres_cm(measured), _centres_cm(truth)
    matched: dict[str, tuple[int, int]] = {}
    missing, extra = [], []
    for plant in (plant for plant in true_of if plant in found_of):
        true, found = true_of[plant], found_of[plant]
        if all(np.isfinite(each).all(axis=1).any() for each in (true_cm[true], found_cm[found])):
            pairs = [(true[i], found[j]) for i, j in match_bolls(true_cm[true], found_cm[found], MATCH_DISTANCE_CM)]
        else:
            by_id = {_boll_id(measured, place): place for place in found}
            pairs = [(place, by_id[boll]) for place in true if (boll := _boll_id(truth, place)) in by_id]
        matched |= {f"{plant}/{_boll_id(truth, place)}": (place, other) for place, other in pairs}
        seen_true, seen_found = {place for place, _ in pairs}, {place for _, place in pairs}
        missing += [f"{plant}/{_boll_id(truth, place)}" for place in true if place not in seen_true]
        extra += [f"{plant}/{_boll_id(measured, place)}" for place in found if place not in seen_found]
    if not matched:
        raise _nothing_common(measured_csv, truth_csv)
    scores, values, blank = _compare(truth, measured, matched)
    if not scores:
        raise _no_trait(measured_csv, truth_csv)
    return TableEvaluation(scores, values, tuple(missing), tuple(extra), (), blank, math.nan)


def is_boll_table(path: Path) -> bool:
    """Whether a table has one row per boll, like batch_bolls.csv, rather than one per plant."""
    return BOLL in read_table(path).columns


def _compare(
    truth: Table, measured: Table, places: dict[str, tuple[int, int]]
) -> tuple[list[TraitScore], dict[str, tuple[Float64, Float64]], dict[str, tuple[str, ...]]]:
    """Scores, pairs of values and blanks of all names with a row in both tables: name -> the places of those rows."""
    scores, pairs, blank = [], {}, {}
    of_truth, of_measured = np.array(list(places.values())).T
    for trait in (name for name in truth.columns if name in measured.columns and name not in NOT_TRAITS):
        if trait not in MEASURED and not _is_numeric(measured, trait):
            continue  # a name, a block, a treatment
        true, found = truth.numbers(trait)[of_truth], measured.numbers(trait)[of_measured]
        if not np.isfinite(true).any():
            continue
        both = np.isfinite(true) & np.isfinite(found)
        scores.append(score(trait, true[both], found[both]))
        pairs[trait] = (true[both], found[both])
        lacking = np.isfinite(true) & ~np.isfinite(found)
        if lacking.any():
            blank[trait] = tuple(name for name, lacks in zip(places, lacking, strict=True) if lacks)
    return scores, pairs, blank


def _is_numeric(table: Table, column: str) -> bool:
    try:
        return bool(np.isfinite(table.numbers(column)).any())
    except BadInput:
        return False


def _centres_cm(table: Table) -> Float64:
    """(N, 3) centre of each row's boll; NaN if the table does not have its place."""
    if not {*PLACE} <= {*table.columns}:
        return np.full((len(table.rows), 3), np.nan)
    return np.stack([table.numbers(axis) for axis in PLACE], 1)


def _boll_id(table: Table, place: int) -> str:
    return table.rows[place][BOLL].strip()


def _read_by_boll(path: Path) -> tuple[Table, dict[str, list[int]]]:
    """A table, and plant -> the places of its rows.

    Raises:
        MissingInput: there is no table. BadInput: it names no plants or bolls, or a boll twice.
    """
    if not path.is_file():
        raise MissingInput(f"{path.name} is missing; give a table with the columns {ID} and {BOLL}")
    table = read_table(path)
    table.require(ID, BOLL)
    counts = Counter((row[ID].strip(), row[BOLL].strip()) for row in table.rows)
    twice = [f"{plant}/{boll}" for (plant, boll), count in counts.items() if count > 1]
    if twice:
        raise BadInput(f"{path.name} has boll {twice[0]} twice; give each boll of a plant a {BOLL} of its own")
    plants: dict[str, list[int]] = {}
    for place, row in enumerate(table.rows):
        plants.setdefault(row[ID].strip(), []).append(place)
    return table, plants


def _nothing_common(measured_csv: Path, truth_csv: Path) -> BadInput:
    return BadInput(f"{measured_csv.name} and {truth_csv.name} have no plant in common; check their {ID} columns")


def _no_trait(measured_csv: Path, truth_csv: Path) -> BadInput:
    return BadInput(f"{truth_csv.name} has no trait of {measured_csv.name}; name its columns as in traits.csv")


SCORES: Final = (
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
    """The scores, one line per trait, and the plants that could not be compared."""
    lines = [f"{'trait':<26}{'n':>4}{'RMSE':>10}{'MAE':>10}{'MAPE %':>9}{'bias':>10}{'R2':>8}{'R2 1:1':>9}"]
    lines += [
        f"{s.trait:<26}{s.n:>4}{s.rmse:>10.3f}{s.mae:>10.3f}{s.mape_pct:>9.2f}{s.bias:>+10.3f}{s.r2:>8.3f}"
        f"{s.r2_identity:>9.3f}"
        for s in evaluation.scores
    ]
    if math.isfinite(evaluation.weight_error_pct):
        lines.append(f"boll weight, each plant predicted from the others: {evaluation.weight_error_pct:.1f} % a plant")
    remarks = {
        "not measured (in the truth only)": evaluation.missing,
        "without truth (measured only)": evaluation.extra,
        "left out, twice in a table": evaluation.repeated,
    } | {f"{trait} is blank": plants for trait, plants in evaluation.blank.items()}
    lines += [f"{what}: {', '.join(plants)}" for what, plants in remarks.items() if plants]
    return "\n".join(lines)


@dataclass(frozen=True)
class PlantTable:
    """A table with one row per plant."""

    table: Table
    places: dict[str, int]
    """Plant -> the place of its row."""
    twice: tuple[str, ...]
    """Plants that have several rows."""

    def numbers(self, column: str, plants: Sequence[str]) -> Float64:
        """(N,) values of these plants; NaN if a cell is blank, or the table does not have the column.

        Raises:
            BadInput: a cell of the column is not a number.
        """
        if column not in self.table.columns:
            return np.full(len(plants), np.nan)
        return self.table.numbers(column)[[self.places[plant] for plant in plants]]


def read_by_plant(path: Path) -> PlantTable:
    """Read a table that names plants.

    Raises:
        MissingInput: the table does not exist. BadInput: it names no plants.
    """
    if not path.is_file():
        raise MissingInput(f"{path.name} is missing; give a table with a column {ID}")
    table = read_table(path)
    table.require(ID)
    names = [row[ID].strip() for row in table.rows]
    twice = tuple(name for name, count in Counter(names).items() if count > 1)
    return PlantTable(table, {name: place for place, name in enumerate(names) if name}, twice)
