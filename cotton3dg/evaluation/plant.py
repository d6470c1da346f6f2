# SPDX-License-Identifier: Apache-2.0
"""One plant's tables against its truth: the error of each trait, and which bolls were found.

The truth is a `truth.json` as `cotton3dg simulate` writes it (metres, origin at the table's centre, z up).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ..core.measurements import is_counted
from ..core.scene import Float64
from ..errors import BadInput, MissingInput
from ..io.cloud import read_cloud
from ..io.tables import flags_of, parse_number, read_rows
from ..plant_map.summary import summarise_map
from ..schemas.truth import Truth
from ..workspace import Workspace
from .cloud import measure_cloud
from .match import MATCH_DISTANCE_CM, match_bolls

TRUTH_OF_TRAIT: Final = {
    "boll_count": "boll_count",
    "boll_volume_cm3": "total_boll_convex_volume_cm3",
    "plant_height_cm": "plant_height_cm",
    "canopy_size_cm": "canopy_size_cm",
    "boll_volume_published_cm3": "total_boll_convex_volume_cm3",
    "plant_height_published_cm": "plant_height_cm",
    "canopy_size_published_cm": "canopy_size_cm",
}
"""The published variants stand beside the defaults; tables of older versions lack them."""


MAP_TRAITS: Final = (
    "stem_length_cm",
    "stem_diameter_mm",
    "stem_lean_deg",
    "branch_count",
    "first_fruiting_branch_height_cm",
    "internode_mean_cm",
    "branch_angle_mean_deg",
    "branch_length_mean_cm",
)
"""Traits of the plant map, compared with those of a scanner's cloud."""


@dataclass(frozen=True)
class TraitError:
    """One trait of one plant; NaN if the trait was not measured."""

    trait: str
    measured: float
    truth: float

    @property
    def error_pct(self) -> float:
        return 100.0 * (self.measured - self.truth) / self.truth if self.truth else math.nan


@dataclass(frozen=True)
class BollMatches:
    """True bolls found within `MATCH_DISTANCE_CM`."""

    n_true: int
    n_measured: int
    n_matched: int
    median_distance_cm: float
    median_volume_error_pct: float
    """Median over matched bolls of the absolute volume error."""
    volume_errors_pct: tuple[float, ...] = ()
    """Error of each matched boll, with its sign; bolls without a volume are left out."""

    @property
    def mean_volume_error_pct(self) -> float:
        """Mean of the absolute errors (MAPE), as Cotton3DGaussians states it."""
        return float(np.mean(np.abs(self.volume_errors_pct))) if self.volume_errors_pct else math.nan

    @property
    def recall(self) -> float:
        return self.n_matched / self.n_true if self.n_true else math.nan

    @property
    def precision(self) -> float:
        return self.n_matched / self.n_measured if self.n_measured else math.nan


def evaluate(workspace: Workspace, truth_json: Path) -> tuple[list[TraitError], BollMatches]:
    """Compare a finished plant with its truth.

    Raises:
        MissingInput: there is no truth, or the traits stage has not run.
        BadInput: the truth lacks a value that is compared.
    """
    if not truth_json.is_file():
        raise MissingInput(f"{truth_json.name} is missing; give the plant's truth with --truth FILE")
    truth = Truth.load(truth_json)
    row = _read_plant_row(workspace)
    errors = [
        TraitError(trait, parse_number(row[trait]), getattr(truth, key))
        for trait, key in TRUTH_OF_TRAIT.items()
        if trait in row
    ]
    rows = read_rows(workspace.require(workspace.bolls_csv, "traits"))
    bolls = [boll for boll in rows if is_counted(flags_of(boll))]
    measured_cm = np.array([[parse_number(boll[f"{axis}_cm"]) for axis in "xyz"] for boll in bolls]).reshape(-1, 3)
    measured_cm3 = np.array([parse_number(boll["volume_cm3"]) for boll in bolls])
    true_cm, true_cm3 = _true_bolls(truth)
    return errors, compare_bolls(measured_cm, measured_cm3, true_cm, true_cm3)


def evaluate_cloud(
    workspace: Workspace, cloud: Path, cm_per_unit: float, tube_height_cm: float = 4.0
) -> list[TraitError]:
    """Compare a finished plant with the traits that the same code measures in a scanner's point cloud, z up.

    Bolls are compared if the cloud marks them (`read_cloud`).

    Raises:
        MissingInput: there is no cloud, or traits has not run. BadInput: the cloud cannot be read, or shows no plant.
    """
    points_cm, labels = read_cloud(cloud, cm_per_unit)
    true = measure_cloud(points_cm, labels, tube_height_cm)
    if not math.isfinite(true.silhouette.height_cm):
        raise BadInput(f"{cloud.name} shows no plant; it needs all of one with z up, and its unit as --cloud-unit")
    row = _read_plant_row(workspace)
    size, volumes = true.silhouette, true.boll_volumes_cm3
    truth = {
        "plant_height_cm": size.height_cm,
        "plant_height_obb_cm": size.height_obb_cm,
        "canopy_size_cm": (size.length_cm + size.width_cm) / 2,
        "canopy_length_cm": size.length_cm,
        "canopy_width_cm": size.width_cm,
        "plant_hull_volume_cm3": size.hull_volume_cm3,
    }
    if labels is not None:
        truth |= {"boll_count": float(len(volumes)), "boll_volume_cm3": float(volumes[np.isfinite(volumes)].sum())}
    mapped = summarise_map(true.plant_map, tube_height_cm, 0.0, 0.0)
    truth |= {
        trait: number for trait in MAP_TRAITS if math.isfinite(number := float(getattr(mapped, trait) or math.nan))
    }
    return [TraitError(trait, parse_number(row.get(trait)), value) for trait, value in truth.items()]


def compare_bolls(measured_cm: Float64, measured_cm3: Float64, true_cm: Float64, true_cm3: Float64) -> BollMatches:
    """Match bolls one to one by the distance of their centres in the plant frame.

    A table looks the same after half a turn: the function tries both directions of x and keeps the better one.

    Args:
        measured_cm: (M, 3), true_cm: (T, 3) centres; rows with NaN match nothing.
        measured_cm3: (M,), true_cm3: (T,) volumes.
    """
    best: tuple[int, float] = (0, math.nan)
    volume_errors_pct = np.zeros(0)
    for turn in ((1, 1, 1), (-1, -1, 1)):
        centres = measured_cm * turn
        pairs = match_bolls(centres, true_cm, MATCH_DISTANCE_CM)
        if len(pairs) <= best[0]:
            continue
        mine, theirs = pairs.T
        best = (len(pairs), float(np.median(np.linalg.norm(centres[mine] - true_cm[theirs], axis=1))))
        relative = measured_cm3[mine] / true_cm3[theirs] - 1.0
        volume_errors_pct = 100.0 * relative[np.isfinite(relative)]
    median_pct = float(np.median(np.abs(volume_errors_pct))) if len(volume_errors_pct) else math.nan
    return BollMatches(
        len(true_cm), len(measured_cm), *best, median_pct, tuple(float(error) for error in volume_errors_pct)
    )


def _true_bolls(truth: Truth) -> tuple[Float64, Float64]:
    """Centres (T, 3) in cm in the plant frame, and volumes (T,) in cm³."""
    centres_m = np.array([boll.centre_xyz_m for boll in truth.bolls], np.float64).reshape(-1, 3)
    volumes_cm3 = np.array([boll.convex_volume_cm3 for boll in truth.bolls], np.float64)
    return 100.0 * (centres_m - np.array(truth.stem_base_xyz_m, np.float64)), volumes_cm3


def _read_plant_row(workspace: Workspace) -> dict[str, str]:
    return read_rows(workspace.require(workspace.traits_csv, "traits"))[0]
