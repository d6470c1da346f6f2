# SPDX-License-Identifier: Apache-2.0
"""From places of wood to a skeleton: the stem, then branch after branch, each the longest path that is left.

TEASAR (Sato et al. 2000, "TEASAR: tree-structure extraction algorithm for accurate and robust skeletons"): shortest
paths lead to a root, the path of the farthest place is an axis, the places along it are done, and so on. Departures:
the graph joins places of Gaussians instead of voxels; the first axis is the path that goes up with the least bend, not
the longest; a place is done only if it hangs on the axis besides lying near, so that an axis does not swallow a
crossing branch; the bolls' feet are ends of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..core.scene import Float64
from ..geometry.polylines import length_of, nearest_on, path_lengths, resampled, smoothed
from .graph import NEAR_CM, WoodGraph, WoodTree, joined, path_to, shortest_paths
from .wood import WoodCloud

ROOT_LAYER_CM: Final = 1.5
"""Height of the layer above the lowest wood in which the root is searched."""
MIN_BRANCH_CM: Final = 2.5
"""Least length of a path without a boll; shorter ones are scars and noise."""
COVER_CM: Final = 0.7
"""Distance from an axis, beyond its radius, within which the places that hang on it are done."""
SIDEWAYS: Final = 3.0
"""Cost of a level centimetre on the way up the stem."""
TOP_SHARE: Final = 0.75
"""Share of the plant's wood that lies below the stem's tip."""
BEND_PRICE_CM: Final = 0.8
"""Height that a degree of all bends beyond `FREE_BEND_DEG` costs when the stem's tip is chosen."""
FREE_BEND_DEG: Final = 12.0
BEND_WINDOW_CM: Final = 3.0
SPACING_CM: Final = 0.3
SMOOTHING: Final = 2.0
"""Standard deviation of the smoothing of a centre line, in points of `SPACING_CM`."""
CENTRE_REACH_CM: Final = 0.7
CENTRINGS: Final = 4
STEM_SMOOTHING: Final = 4.0
STEM_REACH_CM: Final = 1.3
"""The same two values for the stem, which is thicker and bends less."""
SURFACE_CM: Final = 1.5
"""Largest distance between the middle of a stem or branch and its surface."""
LOOP_CM: Final = 4.0
"""Paths that meet sooner after they part do not close a loop."""
LINK_CM: Final = 5.0
"""Largest length of wood between two meeting paths that lies on neither."""
STUB_CM: Final = 1.0
APART_CM: Final = 2.0
"""Least length of a branch that is left beside the stem, and least distance from the foot of the path that it meets."""
MIN_STEM_CM: Final = 12.0
FEWEST_PLACES: Final = 20
"""Least number of places of a cloud with a stem."""
BLADE_CM: Final = 3.0
BESIDE_CM: Final = 0.45
PETIOLE_CM: Final = 9.0
"""Longest bare piece before a blade of a path that is a leaf's stalk."""
BLADE_PLACES: Final = 12
BLADE_SHARE: Final = 0.35
BLADE_ONWARDS: Final = 0.6
"""A path is in a blade where, of the places within `BLADE_CM`, the share `BLADE_SHARE` lies `BESIDE_CM` beside it, as
holds for the share `BLADE_ONWARDS` of its further way; at its tip there are `BLADE_PLACES` places."""
FEWEST_PLACES_PER_CM: Final = 4
"""A centimetre of a path with fewer places counts neither as blade nor as bare."""


@dataclass
class RawAxis:
    """A path through the wood, before its place in the order is known."""

    curve: Float64
    """(N, 3) cm, from its foot outwards."""
    parent: int
    """Index of the axis that it leaves; -1 for the stem."""
    boll: int = 0
    """Index of the boll, from 1, at whose foot it ends; 0 = none."""
    bare_cm: float = np.inf
    """Length before it enters a blade; infinite if it does not enter one."""


@dataclass(frozen=True)
class Meeting:
    """A place where wood goes on from one path to another that grows elsewhere."""

    one: int
    other: int
    """Indices of the paths."""
    link: Float64
    """(N, 3) cm, from a place on the one to a place on the other."""


def extract_axes(cloud: WoodCloud) -> tuple[list[RawAxis], list[Meeting]]:
    """The stem and all paths that leave it or each other, longest first; empty without a stem.

    Returns:
        The paths and the places where they meet.
    """
    if len(cloud.places) < FEWEST_PLACES or np.ptp(cloud.places[:, 2]) < MIN_STEM_CM:
        return [], []
    places, n = cloud.places, len(cloud.places)
    graph, root = joined(places), _root(places)
    wood = places[cloud.bur == 0]
    # The stem goes up, and does not turn aside for bolls and leaves in front of it.
    alike = shortest_paths(graph, np.zeros(n, bool), root, np.zeros((0, 3)), SIDEWAYS)
    stem = centred(places[_stem_rows(alike, cloud)], wood, STEM_REACH_CM, STEM_SMOOTHING)
    if length_of(stem) < MIN_STEM_CM:
        return [], []
    reach = stem_radius(stem, wood) + 0.5 * COVER_CM
    beside = nearest_on(stem, places, reach)[0] < reach
    leaf = cloud.leaf & ~beside
    feet = np.array([body.foot if np.isfinite(body.foot).all() else body.centre for body in cloud.bolls])
    feet = feet.reshape(-1, 3)
    tree = shortest_paths(graph, leaf | ((cloud.bur > 0) & ~beside), root, feet)
    axes = [RawAxis(stem, -1)]
    owner = np.full(len(tree.places), -1)
    owner[:n][beside] = 0
    ends = np.ones(len(tree.places), bool)
    ends[:n] = cloud.end
    while True:
        lengths = _lengths_left(tree, owner)
        lengths[~ends] = -1
        # A boll is an end even if its path is short.
        lengths[n:][lengths[n:] > 0] += MIN_BRANCH_CM
        tip = int(np.argmax(lengths))
        if lengths[tip] < MIN_BRANCH_CM:
            break
        rows = path_to(tree, tip, owner >= 0)
        parent = int(owner[rows[0]])
        curve = centred(tree.places[rows], tree.places[:n][cloud.bur == 0], CENTRE_REACH_CM)
        free = (owner[:n] < 0) & (cloud.bur == 0)
        owner[rows[1:]] = len(axes)
        # Wood of other branches may pass by, still free, but is not a blade, because a blade hangs on the path.
        hanging = _hung_on(tree, owner, owner < 0) == len(axes)
        bare_cm = bare_length(curve, places[free & hanging[:n]]) if tip < n else np.inf
        if (nearest_on(curve, feet[hanging[n:]])[1] > bare_cm).any():
            bare_cm = np.inf  # bolls hang on branches, not on leaves
        axes.append(RawAxis(curve, parent, tip - n + 1 if tip >= n else 0, bare_cm))
        if np.isinf(bare_cm):
            _cover(tree, owner, n, curve, (len(axes) - 1, parent), COVER_CM)
        else:
            _cover(tree, owner, n, curve, (len(axes) - 1,), BLADE_CM)
    hung = _hung_on(tree, owner, owner < 0)[:n]
    leaves = [number for number, axis in enumerate(axes) if np.isfinite(axis.bare_cm)]
    hung[leaf | (cloud.bur > 0) | np.isin(hung, leaves)] = -1
    return axes, _meetings(graph, tree, owner, hung, axes)


def _meetings(
    graph: WoodGraph, tree: WoodTree, owner: NDArray[np.int64], hung: NDArray[np.int64], axes: list[RawAxis]
) -> list[Meeting]:
    """Where wood closes a loop: for each two paths the nearest places, if both are far from where the paths part.

    Args:
        owner: (N,) axis of each place that is done. hung: (N,) the axis to which each place belongs or on which it
            hangs; -1 for places that are not wood.
    """
    pairs = graph.pairs[(hung[graph.pairs] >= 0).all(axis=1)]
    pairs = pairs[hung[pairs[:, 0]] != hung[pairs[:, 1]]]
    steps = np.linalg.norm(np.diff(graph.places[pairs], axis=1)[:, 0], axis=1)
    pairs, steps = pairs[steps <= NEAR_CM], steps[steps <= NEAR_CM]
    found: dict[tuple[int, int], Meeting] = {}
    feet = _feet(tree, axes)
    for row in np.argsort(steps, kind="stable"):
        ends = sorted(pairs[row].tolist(), key=lambda end: int(hung[end]))
        ways = (int(hung[ends[0]]), int(hung[ends[1]]))
        if ways in found:
            continue
        rows = [path_to(tree, end, owner >= 0) for end in ends]
        starts = tree.lengths[[own[0] for own in rows]]
        rests = tree.lengths[ends] - starts
        if rests.sum() > LINK_CM:
            continue
        if ways[0] == 0:
            # A branch that soon touches another one leaves too little beside the stem to be a path.
            closes = rests[0] > STUB_CM and abs(starts[0] - _foot_on_stem(axes, feet, ways[1])) > APART_CM
            closes = closes and tree.lengths[ends[1]] - feet[ways[1]] > LOOP_CM
        else:
            closes = min(tree.lengths[ends] - _parted_cm(axes, feet, ways, starts)) > LOOP_CM
        if closes:
            found[ways] = Meeting(*ways, np.vstack([tree.places[rows[0]], tree.places[rows[1][::-1]]]))
    return list(found.values())


def _feet(tree: WoodTree, axes: list[RawAxis]) -> Float64:
    """(A,) path length from the clamp to the foot of each axis."""
    rows = cKDTree(tree.places).query(np.array([axis.curve[0] for axis in axes]))[1]
    feet: Float64 = tree.lengths[rows]
    return feet


def _foot_on_stem(axes: list[RawAxis], feet: Float64, way: int) -> float:
    while axes[way].parent > 0:
        way = axes[way].parent
    return float(feet[way])


def _parted_cm(axes: list[RawAxis], feet: Float64, ways: tuple[int, int], lengths: Float64) -> float:
    """Path length from the clamp to the point where the paths to places on two axes part."""
    chains = []
    for end, length in zip(ways, lengths, strict=True):
        way, chain = end, {end: float(length)}
        while axes[way].parent >= 0:
            chain[axes[way].parent] = float(feet[way])
            way = axes[way].parent
        chains.append(chain)
    common = next(way for way in chains[0] if way in chains[1])
    return min(chains[0][common], chains[1][common])


def _root(places: Float64) -> int:
    """The middle of the lowest places."""
    low = np.flatnonzero(places[:, 2] < places[:, 2].min() + ROOT_LAYER_CM)
    return int(low[np.argmin(np.linalg.norm(places[low] - np.median(places[low], axis=0), axis=1))])


def _stem_rows(tree: WoodTree, cloud: WoodCloud) -> list[int]:
    """The path up with the least bend among those that end near the top."""
    reached = np.flatnonzero(np.isfinite(tree.cost[: len(cloud.places)]) & (cloud.bur == 0))
    heights = tree.places[reached, 2]
    low = heights.min()
    high = reached[heights > low + TOP_SHARE * (heights.max() - low)]
    none = np.zeros(len(tree.places), bool)
    # One end in each cell of 2 cm, because neighbouring ends give similar paths.
    cells = np.unique(np.floor(tree.places[high] / 2.0).astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    ends = [int(high[cells == cell][np.argmax(tree.cost[high[cells == cell]])]) for cell in range(cells.max() + 1)]
    best, chosen = -np.inf, [int(reached[0])]
    for end in ends:
        rows = path_to(tree, end, none)
        curve = tree.places[rows]
        if length_of(curve) < MIN_STEM_CM:
            continue
        line = smoothed(resampled(curve, SPACING_CM), 4.0)
        score = float(tree.places[end, 2]) - BEND_PRICE_CM * _bends_deg(line)
        if score > best:
            best, chosen = score, rows
    return chosen


def _bends_deg(line: Float64) -> float:
    """The excess of a line's bends over `FREE_BEND_DEG`, summed over pieces of `BEND_WINDOW_CM`.

    The sharpest bend alone does not distinguish paths if it lies on their common piece.
    """
    n = max(1, round(BEND_WINDOW_CM / SPACING_CM))
    if len(line) <= 2 * n:
        return 0.0
    before, after = line[n:-n] - line[: -2 * n], line[2 * n :] - line[n:-n]
    cosines = (before * after).sum(axis=1) / (np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1))
    bends_deg = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return float(np.maximum(bends_deg - FREE_BEND_DEG, 0.0).sum()) / n


def stem_radius(stem: Float64, places: Float64) -> float:
    """Median distance, cm, of the wood beside the lower half of the stem."""
    away, station = nearest_on(stem, places, SURFACE_CM)
    beside = (away < SURFACE_CM) & (station < 0.5 * length_of(stem))
    return float(np.median(away[beside])) if beside.any() else 0.5


def _lengths_left(tree: WoodTree, owner: NDArray[np.int64]) -> Float64:
    """(N,) path length from each place back to a done place; 0 for done places, -1 if no path leads to one."""
    done = owner >= 0
    ends = _followed(np.where(done | (tree.before < 0), np.arange(len(owner)), tree.before))
    return np.where(done[ends], tree.lengths - tree.lengths[ends], -1.0)


def _cover(tree: WoodTree, owner: NDArray[np.int64], n: int, curve: Float64, on: tuple[int, ...], reach: float) -> None:
    """Give the newest axis the places that lie beside it and hang on it; only the first n, as the others are feet.

    Args:
        on: the axis itself and its parent, as some places beside the foot of the axis hang on the parent.
    """
    passed = (owner < 0) & (nearest_on(curve, tree.places, reach)[0] < reach)
    own = passed & np.isin(_hung_on(tree, owner, passed), on)
    own[n:] = False
    owner[own] = on[0]


def _hung_on(tree: WoodTree, owner: NDArray[np.int64], through: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(N,) the first axis on each place's path to the clamp, over places of `through` alone; -1 = none."""
    return owner[_followed(np.where(through & (tree.before >= 0), tree.before, np.arange(len(owner))))]


def _followed(following: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) the row at which the path from each row ends, if each row leads to another one or to itself."""
    while (further := following[following] != following).any():
        following = np.where(further, following[following], following)
    return following


def bare_length(curve: Float64, free: Float64) -> float:
    """Length, cm, of an axis before it enters a blade, in which many near places lie beside it as far as its tip;
    infinite if it does not enter one.

    Args:
        free: (N, 3) places that hang on this axis only.
    """
    away, station = nearest_on(curve, free, BLADE_CM)
    near, beside = away < BLADE_CM, away > BESIDE_CM
    tip = near & (station > length_of(curve) - BLADE_CM)
    if tip.sum() < BLADE_PLACES or np.mean(beside[tip]) < BLADE_SHARE:
        return np.inf
    bins = np.arange(0.0, length_of(curve) + 1.0)
    counts = np.histogram(station[near], bins)[0]
    dense = counts >= FEWEST_PLACES_PER_CM
    blade = dense & (np.histogram(station[near & beside], bins)[0] > BLADE_SHARE * counts)
    # The blade begins at the first piece that is blade, as is most of the way behind it.
    onwards = np.cumsum(blade[::-1])[::-1] / np.maximum(np.cumsum(dense[::-1])[::-1], 1)
    first = np.flatnonzero(blade & (onwards > BLADE_ONWARDS))
    return float(first[0]) if len(first) else length_of(curve)


def centred(way: Float64, places: Float64, reach: float, smoothing: float = SMOOTHING) -> Float64:
    """The centre line of a path: every point moves across to the middle of the wood beside it, then all are smoothed.

    Args:
        way: (K, 3) cm, the path. places: (N, 3) cm of wood. reach: cm, distance up to which wood belongs to the path.
        smoothing: standard deviation, in points, of the smoothing and of the window in which wood is averaged.
    """
    line = smoothed(resampled(way, SPACING_CM), smoothing)
    half = round(smoothing)
    kernel = np.exp(-0.5 * (np.arange(-2 * half, 2 * half + 1) / smoothing) ** 2)
    for _ in range(CENTRINGS):
        if len(line) <= len(kernel):
            return line
        away, station = nearest_on(line, places, reach)
        near = away < reach
        lengths = path_lengths(line)
        bins = np.clip(np.searchsorted(lengths, station[near] - 0.5 * SPACING_CM), 0, len(line) - 1)
        tangents = np.gradient(line, axis=0)
        tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-9)
        offsets = places[near] - line[bins]
        offsets -= (offsets * tangents[bins]).sum(axis=1, keepdims=True) * tangents[bins]
        weights = np.convolve(np.bincount(bins, minlength=len(line)), kernel, "same")
        sums = [np.convolve(np.bincount(bins, axis, len(line)), kernel, "same") for axis in offsets.T]
        # A point without wood beside it does not move.
        line = line + np.column_stack(sums) / np.maximum(weights, 0.5)[:, None]
        line = smoothed(resampled(line, SPACING_CM), 0.5 * smoothing)
    return line
