# SPDX-License-Identifier: Apache-2.0
"""A plant's map against the true skeleton: branches found, their shape, and bolls on the right branch.

Branches match by the place of their foot and the direction in which they leave the stem.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ..core.plant_map import Axis, BollOnMap, PlantMap
from ..core.scene import Float64
from ..geometry.polylines import angle_deg, direction, length_of, path_lengths
from ..io.tables import parse_number, read_rows
from ..plant_map.branching_order import base_angle_deg
from ..plant_map.summary import summarise_map
from ..schemas.skeleton import SkeletonInfo, read_map
from ..schemas.truth import Truth
from ..workspace import Workspace
from .match import MATCH_DISTANCE_CM, match_bolls

FOOT_CM: Final = 3.0
DIRECTION_DEG: Final = 30.0
"""A branch matches a true one if their feet are no farther apart and their directions differ by no more."""
LONG_ENOUGH_CM: Final = 3.0
"""Shorter true branches need not be found; a found one is not a mistake."""


@dataclass(frozen=True)
class MapScores:
    """How well a map agrees with the truth; NaN if there is nothing to compare."""

    true_branches: int
    """Fruiting branches that are long enough."""
    measured_branches: int
    """Fruiting branches, except those that match a true one that is too short."""
    matched_branches: int
    angle_error_deg: float
    """Mean absolute error over matched branches."""
    length_error_pct: float
    """Mean absolute error, relative, over matched branches."""
    bolls: int
    """Bolls found that have a true branch."""
    bolls_on_branch: int
    """Of them, those on the right branch."""
    doubtful: int
    """Bolls whose branch the map itself doubts."""
    doubtful_on_branch: int
    """Of them, those on the right branch."""
    positions: int
    """Bolls found that have a true fruiting position."""
    positions_right: int
    """Of them, those with the right one of 1, 2, 3 and beyond."""
    first_height_error_cm: float
    """Error for the lowest fruiting branch, measured minus true; as in all that follow."""
    internode_error_pct: float
    stem_diameter_error_mm: float
    stem_length_error_pct: float

    @property
    def recall(self) -> float:
        return self.matched_branches / self.true_branches if self.true_branches else math.nan

    @property
    def precision(self) -> float:
        return self.matched_branches / self.measured_branches if self.measured_branches else math.nan

    @property
    def f1(self) -> float:
        total = self.true_branches + self.measured_branches
        return 2 * self.matched_branches / total if total else math.nan


def evaluate_map(workspace: Workspace, truth_json: Path) -> MapScores | None:
    """Scores of a finished plant's map; None if the truth has no skeleton.

    Raises:
        MissingInput: the traits stage has not run. BadInput: a file is damaged.
    """
    truth = Truth.load(truth_json)
    true = true_map(truth)
    if true is None:
        return None
    measured = read_map(SkeletonInfo.load(workspace.require(workspace.skeleton_json, "traits")))
    rows = read_rows(workspace.require(workspace.bolls_csv, "traits"))
    centres_cm = np.array([[parse_number(row[f"{axis}_cm"]) for axis in "xyz"] for row in rows]).reshape(-1, 3)
    base = np.array(truth.stem_base_xyz_m, np.float64)
    true_cm = 100 * (np.array([boll.centre_xyz_m for boll in truth.bolls], np.float64).reshape(-1, 3) - base)
    clamp_cm = truth.clamp_tube_height_cm
    return compare_maps(measured, centres_cm, [int(row["boll_id"]) for row in rows], true, true_cm, clamp_cm)


def true_map(truth: Truth) -> PlantMap | None:
    """The map that a truth's skeleton gives, in the plant frame; None without a skeleton.

    Stem and branches end, like measured ones, at their tip or at the foot of their last boll, whichever is farther out.
    """
    if not truth.skeleton:
        return None
    base = np.array(truth.stem_base_xyz_m, np.float64)
    curves = {axis.id: 100 * (np.array(axis.points_m, np.float64) - base) for axis in truth.skeleton}
    stalks = {axis.boll_id: axis for axis in truth.skeleton if axis.kind == "peduncle"}
    wood = [axis for axis in truth.skeleton if axis.kind != "peduncle"]
    bolls: list[BollOnMap] = []
    carried: dict[int, list[tuple[float, int, int]]] = {axis.id: [] for axis in wood}
    for number, boll in enumerate(truth.bolls, start=1):
        stalk = stalks.get(number)
        if stalk is None or boll.axis is None:
            continue
        station = _station(curves[boll.axis], curves[stalk.id][0])
        carried[boll.axis].append((station, number, stalk.id))
    branches = sorted((axis for axis in wood if axis.kind != "stem"), key=lambda axis: curves[axis.id][0, 2])
    rank_of = {axis.id: rank for rank, axis in enumerate(branches, start=1)}
    stem = next(axis for axis in wood if axis.kind == "stem")
    rank_of[stem.id] = 0
    axes = []
    for axis in [stem, *branches]:
        own = sorted(carried[axis.id])
        curve, radii = curves[axis.id], 0.1 * np.array(axis.radius_mm, np.float64)
        if own:
            station, _, stalk_id = own[-1]
            if station + length_of(curves[stalk_id]) > length_of(curve):
                kept = path_lengths(curve) <= station
                curve = np.vstack([curve[kept], curves[stalk_id]])
                radii = np.append(radii[kept], np.full(len(curves[stalk_id]), np.nan))
        parent = -1 if axis.parent is None else rank_of[axis.parent]
        axes.append(Axis(rank_of[axis.id], axis.kind, parent, curve, radii, 1.0, tuple(number for _, number, _ in own)))
        for rank, (station, number, stalk_id) in enumerate(own, start=1):
            position = truth.bolls[number - 1].position
            bolls.append(
                BollOnMap(
                    number, rank_of[axis.id], rank, curves[stalk_id], station, min(position or 0, 3), math.nan, 1.0
                )
            )
    return PlantMap(tuple(axes), tuple(sorted(bolls, key=lambda boll: boll.boll_id)))


def compare_maps(
    measured: PlantMap, centres_cm: Float64, ids: list[int], true: PlantMap, true_cm: Float64, clamp_cm: float = 4.0
) -> MapScores:
    """Scores of a map.

    A table looks the same after half a turn: the function tries both directions of x and keeps the better one.

    Args:
        centres_cm: (M, 3) of the measured bolls and ids: their numbers. true_cm: (T, 3) of bolls 1 to T.
    """
    scores = [
        _scores(_turned(measured, turn), centres_cm * turn, ids, true, true_cm, clamp_cm)
        for turn in (np.array([1, 1, 1]), np.array([-1, -1, 1]))
    ]
    return max(scores, key=lambda score: score.bolls + score.matched_branches)


def _scores(
    measured: PlantMap, centres_cm: Float64, ids: list[int], true: PlantMap, true_cm: Float64, clamp_cm: float
) -> MapScores:
    pairs = match_branches(measured.branches, true.branches)
    true_of = {measured.branches[i].rank: true.branches[j] for i, j in pairs}
    long_enough = [
        axis for axis in true.branches if axis.kind == "fruiting" and length_of(axis.curve) >= LONG_ENOUGH_CM
    ]
    wanted = {axis.rank for axis in long_enough}
    right = [
        (axis, true_of[axis.rank])
        for axis in measured.branches
        if axis.kind == "fruiting" and axis.rank in true_of and true_of[axis.rank].rank in wanted
    ]
    short = sum(
        axis.kind == "fruiting" and axis.rank in true_of and length_of(true_of[axis.rank].curve) < LONG_ENOUGH_CM
        for axis in measured.branches
    )
    angles = [
        abs(base_angle_deg(a.curve, measured.axes[a.parent].curve) - base_angle_deg(b.curve, true.axes[b.parent].curve))
        for a, b in right
    ]
    lengths = [abs(length_of(a.curve) / length_of(b.curve) - 1) for a, b in right]
    sites, true_sites = ({boll.boll_id: boll for boll in own.bolls} for own in (measured, true))
    found = [(sites.get(ids[i]), true_sites[j + 1]) for i, j in match_bolls(centres_cm, true_cm, MATCH_DISTANCE_CM)
             if j + 1 in true_sites]  # fmt: skip
    rank_of = {0: 0} | {rank: axis.rank for rank, axis in true_of.items()}
    on_branch = [mine is not None and rank_of.get(mine.branch) == theirs.branch for mine, theirs in found]
    doubtful = [mine is not None and mine.doubtful for mine, _ in found]
    sited = [(mine, theirs) for mine, theirs in found if theirs.position]
    own, other = (summarise_map(each, clamp_cm, 0.0, 0.0) for each in (measured, true))
    return MapScores(
        true_branches=len(long_enough),
        measured_branches=sum(axis.kind == "fruiting" for axis in measured.branches) - short,
        matched_branches=len(right),
        angle_error_deg=float(np.mean(angles)) if angles else math.nan,
        length_error_pct=100 * float(np.mean(lengths)) if lengths else math.nan,
        bolls=len(found),
        bolls_on_branch=sum(on_branch),
        doubtful=sum(doubtful),
        doubtful_on_branch=sum(right for right, doubt in zip(on_branch, doubtful, strict=True) if doubt),
        positions=len(sited),
        positions_right=sum(mine is not None and mine.position == theirs.position for mine, theirs in sited),
        first_height_error_cm=own.first_fruiting_branch_height_cm - other.first_fruiting_branch_height_cm,
        internode_error_pct=100 * (own.internode_mean_cm / other.internode_mean_cm - 1),
        stem_diameter_error_mm=own.stem_diameter_mm - other.stem_diameter_mm,
        stem_length_error_pct=100 * (own.stem_length_cm / other.stem_length_cm - 1),
    )


def match_branches(measured: tuple[Axis, ...], true: tuple[Axis, ...]) -> list[tuple[int, int]]:
    """Pairs of indices: the most that agree in foot and direction, and among such sets the nearest on the whole."""
    from scipy.optimize import linear_sum_assignment

    costs = np.full((len(measured), len(true)), np.inf)
    for i, mine in enumerate(measured):
        for j, theirs in enumerate(true):
            apart = float(np.linalg.norm(mine.curve[0] - theirs.curve[0]))
            stop = min(6.0, length_of(mine.curve), length_of(theirs.curve))
            turned = angle_deg(direction(mine.curve, 0.0, stop), direction(theirs.curve, 0.0, stop))
            if apart <= FOOT_CM and turned <= DIRECTION_DEG:
                costs[i, j] = apart / FOOT_CM + turned / DIRECTION_DEG
    padded = np.where(np.isfinite(costs), costs, 1e3)
    return [(int(i), int(j)) for i, j in zip(*linear_sum_assignment(padded), strict=True) if np.isfinite(costs[i, j])]


def _turned(plant_map: PlantMap, turn: Float64) -> PlantMap:
    axes = tuple(Axis(a.rank, a.kind, a.parent, a.curve * turn, a.radii, a.confidence, a.bolls) for a in plant_map.axes)
    return PlantMap(axes, plant_map.bolls, plant_map.reason)


def _station(curve: Float64, place: Float64) -> float:
    return float(path_lengths(curve)[int(np.argmin(np.linalg.norm(curve - place, axis=1)))])
