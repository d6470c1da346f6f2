# SPDX-License-Identifier: Apache-2.0
"""Genotypes compared: means with errors, an F test, and heritability by a mixed model."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.columns import Column
from ..core.scene import Float64
from ..io.tables import parse_number
from .columns import find_roles

TRAITS: Final = ("boll_count", "boll_volume_cm3", "boll_volume_mean_cm3", "plant_height_cm", "canopy_size_cm")
LEAST_GENOTYPES: Final = 2

MEANS_COLUMNS: Final = (
    Column("trait", "", "column of batch.csv"),
    Column("genotype", "", "as the field book has it"),
    Column("plants", "1", "with a value"),
    Column("mean", "of the trait", "of the plants", 3),
    Column("adjusted_mean", "of the trait", "least-squares mean: of a plant in the average block and treatment", 3),
    Column("standard_error", "of the trait", "of the adjusted mean", 3),
)
FIT_COLUMNS: Final = (
    Column("trait", "", "column of batch.csv"),
    Column("model", "", "what a value is the sum of"),
    Column("plants", "1", "with a value"),
    Column("genotypes", "1", "with at least one plant"),
    Column("f_genotype", "1", "F of genotypes, after block and treatment", 3),
    Column("p_genotype", "1", "its probability were all genotypes alike", 5),
    Column("variance_genotype", "square of the trait's", "REML", 4),
    Column("variance_residual", "square of the trait's", "REML", 4),
    Column("heritability", "1", "broad sense, of a genotype's mean", 3),
)


@dataclass(frozen=True)
class Mean:
    """A genotype's mean of a trait."""

    trait: str
    genotype: str
    plants: int
    mean: float
    adjusted_mean: float
    standard_error: float


@dataclass(frozen=True)
class Fit:
    """The result of one trait for all genotypes together; NaN if there are too few plants."""

    trait: str
    model: str
    plants: int
    genotypes: int
    f_genotype: float
    p_genotype: float
    variance_genotype: float
    variance_residual: float
    heritability: float


@dataclass(frozen=True)
class Trial:
    """What a page of all plants shows besides their rows."""

    columns: tuple[str, ...] = ()
    """Columns of the field book, with their names in the rows."""
    means: Sequence[Mean] = ()
    fits: Sequence[Fit] = ()
    unfilmed: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Plants of the field book that have no folder -> their cells."""


def compare_genotypes(
    rows: Sequence[Mapping[str, Any]], columns: Sequence[str], traits: Sequence[str] = TRAITS
) -> tuple[list[Mean], list[Fit]]:
    """Means and fits of each trait; empty without a column for genotypes or with fewer than two genotypes.

    Args:
        rows: of batch.csv with the field book's columns. columns: those of the field book.
    """
    roles = find_roles(columns)
    if "genotype" not in roles:
        return [], []
    means: list[Mean] = []
    fits: list[Fit] = []
    for trait in traits:
        known = [
            row for row in rows if str(row[roles["genotype"]]).strip() and np.isfinite(parse_number(row.get(trait)))
        ]
        values = np.array([parse_number(row[trait]) for row in known])
        factors: dict[str, NDArray[np.str_]] = {
            role: np.array([str(row[roles[role]]) for row in known])
            for role in ("genotype", "block", "treatment")
            if role in roles
        }
        if len(set(factors["genotype"])) >= LEAST_GENOTYPES:
            own, fit = compare(trait, values, factors)
            means += own
            fits.append(fit)
    return means, fits


def compare(trait: str, values: Float64, factors: Mapping[str, NDArray[np.str_]]) -> tuple[list[Mean], Fit]:
    """One trait.

    Least squares of genotype + block + treatment as fixed effects gives the adjusted means and F. For the heritability
    the genotypes are random: REML of the same model; H² = σ²g / (σ²g + σ²e / r) with r the harmonic mean of the plants
    a genotype has (Nyquist 1991 for equal numbers; unequal ones make it approximate).

    Args:
        values: (N,). factors: genotype, and where they are known block and treatment, (N,) each.
    """
    genotypes, group = np.unique(factors["genotype"], return_inverse=True)
    n, k = len(values), len(genotypes)
    counts = np.bincount(group, minlength=k)
    others = [_dummies(labels) for name, labels in factors.items() if name != "genotype"]
    nuisance = np.column_stack([np.zeros((n, 0)), *others])
    full = np.column_stack([np.eye(k)[group], nuisance])
    solution, rank, residual = _least_squares(full, values)
    reduced_rank, reduced = _least_squares(np.column_stack([np.ones(n), nuisance]), values)[1:]
    free = n - rank
    f = p = error = np.nan
    # Equal values leave only rounding errors.
    if free > 0 and rank > reduced_rank and residual > 1e-12 * float((values**2).sum()):
        from scipy.stats import f as f_distribution

        error = residual / free
        f = (reduced - residual) / (rank - reduced_rank) / error
        p = float(f_distribution.sf(f, rank - reduced_rank, free))
    covariance = np.linalg.pinv(full.T @ full) * error
    variances = _variances(values, nuisance, group) if free > 0 and counts.max() > 1 else (np.nan, np.nan)
    replicates = k / np.sum(1 / counts)
    total = variances[0] + variances[1] / replicates
    model = " + ".join(factors)
    fit = Fit(trait, model, n, k, f, p, *variances, variances[0] / total if total > 0 else np.nan)
    return [
        Mean(trait, str(name), int(counts[i]), float(values[group == i].mean()), float(solution[i]),
             float(np.sqrt(covariance[i, i])))
        for i, name in enumerate(genotypes)
    ], fit  # fmt: skip


def _dummies(labels: NDArray[np.str_]) -> Float64:
    """(N, L - 1) indicators of all L labels but the first for each row, minus their mean over the labels."""
    names = np.unique(labels)
    centred: Float64 = (labels[:, None] == names[1:]).astype(np.float64) - 1 / len(names)
    return centred


def _least_squares(design: Float64, values: Float64) -> tuple[NDArray[Any], int, float]:
    """Solution, rank and sum of the squared residuals."""
    solution, _, rank, _ = np.linalg.lstsq(design, values, rcond=None)
    return solution, int(rank), float(((values - design @ solution) ** 2).sum())


def _variances(values: Float64, nuisance: Float64, group: NDArray[np.int64]) -> tuple[float, float]:
    """Variances of genotypes and of the rest by REML; NaN if statsmodels is not installed or finds none."""
    try:
        from statsmodels.regression.mixed_linear_model import MixedLM
    except ImportError:
        return np.nan, np.nan
    spread = float(values.std())
    if spread <= 0:
        return np.nan, np.nan
    # Columns that are linear combinations of others make the model singular.
    design = np.ones((len(values), 1))
    for column in nuisance.T:
        wider = np.column_stack([design, column])
        design = wider if np.linalg.matrix_rank(wider) == wider.shape[1] else design
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a variance of zero is a result
            fitted = MixedLM(values / spread, design, groups=group).fit(reml=True)
        return float(fitted.cov_re[0, 0]) * spread**2, float(fitted.scale) * spread**2
    except (np.linalg.LinAlgError, ValueError):
        return np.nan, np.nan
