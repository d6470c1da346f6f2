# SPDX-License-Identifier: Apache-2.0
"""The traits of a plant's map: rows for its branches and bolls, and the plant's own."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..core.map_measurements import BollMapTraits, BranchTraits, MapTraits
from ..core.plant_map import Axis, PlantMap
from ..core.scene import Float64
from ..geometry.polylines import length_of, nearest_on, path_lengths
from .branching_order import base_angle_deg

DIAMETER_ABOVE_CLAMP_CM: Final = 5.0
BRANCH_DIAMETER_CM: Final = 5.0
EDGE_PX: Final = 0.3
"""Standard error of a width (docs/notes/plant_map.md)."""
TIP_CM: Final = 0.5
"""Standard error of where a branch ends."""
BASE_CM: Final = 3.0
"""Length over which a branch's angle is measured."""
BOLL_AT_TIP_CM: Final = 2.0
"""Standard error of the end of a stem with a boll on it: the boll hides the tip, and the stem goes on into a stalk."""
WRONG_SHARE: Final = 0.09
"""Share of the branches that are missing or false (docs/notes/plant_map.md); ..."""
LENGTH_SHARE: Final = 0.2
ANGLE_DEG: Final = 9.0
FOOT_CM: Final = 0.4
"""... a branch that has another's outer part, or lacks its own, errs by this share in its length, and by these values
in its angle and in the place of its foot."""


def branch_rows(plant_map: PlantMap) -> list[BranchTraits]:
    return [_branch_row(plant_map, axis) for axis in plant_map.branches]


def _branch_row(plant_map: PlantMap, axis: Axis) -> BranchTraits:
    chord = axis.curve[-1] - axis.curve[0]
    return BranchTraits(
        branch=axis.rank,
        kind=axis.kind,
        parent=axis.parent,
        height_cm=float(axis.curve[0, 2]),
        azimuth_deg=float(np.degrees(np.arctan2(chord[1], chord[0])) % 360),
        angle_deg=base_angle_deg(axis.curve, plant_map.axes[axis.parent].curve),
        length_cm=length_of(axis.curve),
        reach_cm=float(np.linalg.norm(chord)),
        diameter_mm=20 * _median(axis.radii[path_lengths(axis.curve) <= BRANCH_DIAMETER_CM]),
        n_bolls=len(axis.bolls),
        boll_ids=axis.bolls,
        confidence=axis.confidence,
    )


def boll_rows(plant_map: PlantMap) -> dict[int, BollMapTraits]:
    """Boll -> its place on the map, without bolls that are not connected with the stem."""
    return {
        boll.boll_id: BollMapTraits(
            branch=boll.branch,
            branch_confidence=boll.confidence,
            rank_on_branch=boll.rank,
            path_from_stem_cm=boll.path_cm if boll.branch else 0.0,
            fruiting_position=boll.position or None,
            fruiting_position_confidence=boll.position_confidence,
        )
        for boll in plant_map.bolls
    }


def summarise_map(plant_map: PlantMap, clamp_cm: float, relative_error: float, pixel_cm: float) -> MapTraits:
    """The plant's traits.

    Args:
        clamp_cm: height of the clamp. relative_error: of lengths. pixel_cm: width of a pixel of the training images.
    """
    if not plant_map.axes:
        return MapTraits()
    stem, branches = plant_map.stem, plant_map.branches
    # The clamp hides the foot; the origin gives its place.
    hidden_cm = float(np.linalg.norm(stem.curve[0]))
    length_cm = hidden_cm + length_of(stem.curve)
    diameter_mm = _diameter_mm(stem, clamp_cm + DIAMETER_ABOVE_CLAMP_CM)
    tip = stem.curve[-1]
    on_stem = [axis for axis in branches if axis.parent == 0]
    stations = np.sort(nearest_on(stem.curve, np.array([axis.curve[0] for axis in on_stem]).reshape(-1, 3))[1])
    internode_cm = float(np.diff(stations).mean()) if len(stations) > 1 else math.nan
    fruiting = [axis for axis in branches if axis.kind == "fruiting"]
    first_cm = min((float(axis.curve[0, 2]) for axis in fruiting if axis.parent == 0), default=math.nan)
    angles = [base_angle_deg(axis.curve, stem.curve) for axis in on_stem]
    lengths = np.array([length_of(axis.curve) for axis in branches])
    mean_length = float(lengths.mean()) if len(lengths) else math.nan
    positions = [boll.position for boll in plant_map.bolls if boll.position]
    by_position = (positions.count(1), positions.count(2), positions.count(3))
    shares = np.array([axis.confidence for axis in branches])
    many = math.sqrt(max(len(branches), 1))
    # One more or less of the branches on the stem makes another internode of the same length of stem.
    by_count = internode_cm * math.sqrt(WRONG_SHARE * len(on_stem)) / max(len(stations) - 1, 1)

    def error(value: float, own: float) -> float:
        return float(np.hypot(value * relative_error, own))

    return MapTraits(
        stem_length_cm=length_cm,
        stem_length_error_cm=error(length_cm, math.hypot(2 * pixel_cm, BOLL_AT_TIP_CM if stem.bolls else 0.0)),
        stem_diameter_mm=diameter_mm,
        stem_diameter_error_mm=error(diameter_mm, 10 * EDGE_PX * pixel_cm),
        stem_lean_deg=float(np.degrees(np.arctan2(np.hypot(tip[0], tip[1]), tip[2]))),
        branch_count=len(branches),
        branch_count_error=float(np.sqrt(WRONG_SHARE * len(branches) + (shares * (1 - shares)).sum())),
        fruiting_branch_count=len(fruiting),
        bearing_branch_count=sum(bool(axis.bolls) for axis in branches),
        first_fruiting_branch_height_cm=first_cm,
        first_fruiting_branch_height_error_cm=error(first_cm, math.hypot(pixel_cm, FOOT_CM)),
        internode_mean_cm=internode_cm,
        internode_mean_error_cm=error(
            internode_cm, math.hypot(by_count, pixel_cm * math.sqrt(2) / max(len(stations) - 1, 1))
        ),
        branch_angle_mean_deg=float(np.mean(angles)) if angles else math.nan,
        branch_angle_mean_error_deg=math.hypot(math.degrees(pixel_cm / BASE_CM), ANGLE_DEG) / math.sqrt(len(angles))
        if angles
        else math.nan,
        branch_length_mean_cm=mean_length,
        branch_length_mean_error_cm=error(mean_length, math.hypot(TIP_CM, LENGTH_SHARE * mean_length) / many),
        branch_density=_densities(stem.curve, branches, length_cm),
        bolls_by_branch=tuple(len(axis.bolls) for axis in branches) if branches else None,
        bolls_by_position=by_position,
        first_position_share_pct=100 * by_position[0] / len(positions) if positions else math.nan,
    )


def _diameter_mm(stem: Axis, height_cm: float) -> float:
    """Diameter, mm, where the stem passes a height; NaN where no silhouette shows it."""
    if not stem.curve[0, 2] <= height_cm <= stem.curve[-1, 2]:
        return math.nan
    row = int(np.argmin(np.abs(stem.curve[:, 2] - height_cm)))
    return 20 * _median(stem.radii[max(0, row - 4) : row + 5])


def _densities(stem: Float64, branches: tuple[Axis, ...], length_cm: float) -> tuple[float, float, float]:
    """Length of branches over length of stem in each third of its height."""
    sums = np.zeros(3)
    for axis in branches:
        third = int(np.clip(3 * axis.curve[0, 2] / max(float(stem[-1, 2]), 1e-6), 0, 2))
        sums[third] += length_of(axis.curve)
    low, middle, high = (float(total) for total in sums / (length_cm / 3))
    return low, middle, high


def _median(values: Float64) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan
