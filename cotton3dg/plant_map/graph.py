# SPDX-License-Identifier: Apache-2.0
"""Wood as a graph: near places are joined, gaps are bridged at a cost, and shortest paths lead to the clamp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from ..core.scene import Float64

NEIGHBOURS: Final = 12
NEAR_CM: Final = 1.0
"""Largest distance of places that are joined at once."""
GAP_CM: Final = 0.5
"""A step of this length costs twice its length, longer ones more and more, because seen places of wood lie closer."""
COARSE_CM: Final = 0.8
FAR_CM: Final = 4.0
FAR_NEIGHBOURS: Final = 16
"""Spacing of the places that are also joined over longer distances, this distance, and the number of neighbours: for
gaps in wood that is connected elsewhere."""
BRIDGE_CM: Final = 7.0
"""The widest gap behind a boll or leaf that is bridged."""
SMALL_PART: Final = 64
"""Number of places up to which a part is small; larger parts are few."""
DEAR: Final = 2.0
"""Cost, in its lengths, of a path through blades, burs and other bolls."""


@dataclass(frozen=True)
class WoodTree:
    """Shortest paths from every place to the clamp."""

    places: Float64
    """(N, 3) cm, the wood's and then one for each boll."""
    before: NDArray[np.int64]
    """(N,) the next place towards the clamp; -1 for the root and for places that are not connected."""
    cost: Float64
    """(N,) of the path to the root; infinite where there is none."""
    lengths: Float64
    """(N,) cm of the path to the root."""


@dataclass(frozen=True)
class WoodGraph:
    """Which places are joined."""

    places: Float64
    """(N, 3) cm."""
    pairs: NDArray[np.int64]
    """(P, 2) rows, each pair once."""


def joined(places: Float64) -> WoodGraph:
    """Near places are joined, and parts with the parts that are nearest to them."""
    pairs = _neighbours(places, NEIGHBOURS, NEAR_CM)
    coarse = np.unique(np.floor(places / COARSE_CM).astype(np.int64), axis=0, return_index=True)[1]
    far = coarse[_neighbours(places[coarse], FAR_NEIGHBOURS, FAR_CM)]
    pairs = _each_once(np.vstack([pairs, far]), len(places))
    return WoodGraph(places, np.vstack([pairs, _bridges(places, pairs)]))


def shortest_paths(
    graph: WoodGraph, dear: NDArray[np.bool_], root: int, feet: Float64, sideways: float = 1.0
) -> WoodTree:
    """Dijkstra's shortest paths to a root; no path leads through the bolls' feet.

    Args:
        dear: (N,) places that a path should avoid. feet: (B, 3) cm. sideways: cost of a level centimetre.
    """
    wood, pairs, n = graph.places, graph.pairs, len(graph.places)
    lengths = np.linalg.norm((wood[pairs[:, 0]] - wood[pairs[:, 1]]) * (sideways, sideways, 1.0), axis=1)
    factors = np.where(dear, DEAR, 1.0)
    costs = _costs(lengths) * 0.5 * (factors[pairs[:, 0]] + factors[pairs[:, 1]])
    matrix = coo_matrix((np.maximum(costs, 1e-9), pairs.T), shape=(n, n)).tocsr()
    cost, before = dijkstra(matrix, directed=False, indices=root, return_predecessors=True)
    before = np.where(before < 0, -1, before).astype(np.int64)
    if len(feet):
        k = np.arange(1, min(NEIGHBOURS, n) + 1)
        distances, near = cKDTree(wood).query(feet, k=k, distance_upper_bound=BRIDGE_CM)
        totals = np.append(cost, np.inf)[near] + _costs(distances)
        best = np.argmin(totals, axis=1)
        reached = np.isfinite(totals.min(axis=1))
        cost = np.append(cost, totals.min(axis=1))
        before = np.append(before, np.where(reached, near[np.arange(len(feet)), best], -1))
    places = np.vstack([wood, feet])
    steps = np.linalg.norm(places - places[before], axis=1)
    path_lengths = np.zeros(len(places))
    for row in np.argsort(cost, kind="stable"):
        if before[row] >= 0:
            path_lengths[row] = path_lengths[before[row]] + steps[row]
    return WoodTree(places, before, cost, path_lengths)


def _costs(lengths: Float64) -> Float64:
    return lengths * (1 + (lengths / GAP_CM) ** 1.5)


def _neighbours(places: Float64, k: int, reach: float) -> NDArray[np.int64]:
    """(P, 2) rows of places no farther apart than `reach`, the k - 1 nearest of each; each pair once."""
    k = min(k, len(places))
    if k < 2:
        return np.zeros((0, 2), np.int64)
    distances, others = cKDTree(places).query(places, k=k, distance_upper_bound=reach)
    rows = np.repeat(np.arange(len(places)), k).reshape(len(places), k)
    kept = np.isfinite(distances) & (others != rows)
    return _each_once(np.column_stack([rows[kept], others[kept]]), len(places))


def _each_once(pairs: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """(P, 2) pairs of n rows, sorted, without repeated ones in either order."""
    # Numbers are sorted in a tenth of the time that rows take.
    keys = np.sort(np.minimum(*pairs.T) * n + np.maximum(*pairs.T))
    return np.column_stack(np.divmod(keys[np.append(True, keys[1:] != keys[:-1])[: len(keys)]], n))


def _bridges(places: Float64, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """(B, 2) the nearest pairs between parts, until all within `BRIDGE_CM` are connected (Borůvka's spanning tree).

    Every part gets its nearest bridges to several others, not one bridge only; the shortest path decides which it
    crosses.
    """
    n, whole = len(places), cKDTree(places)
    found = [np.zeros((0, 2), np.int64)]
    for _ in range(8):
        edges = np.vstack([pairs, *found])
        matrix = coo_matrix((np.ones(len(edges)), edges.T), shape=(n, n))
        count, part = connected_components(matrix, directed=False)
        if count == 1:
            break
        added = []
        members = np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part))[:-1])
        for one, own in enumerate(members):
            distances, nearest = _nearest_outside(places, whole, part, one, own)
            order = np.argsort(distances, kind="stable")[:3]
            order = order[np.isfinite(distances[order])]
            added += [sorted((int(own[i]), int(nearest[i]))) for i in order]
        if not added:
            break
        found.append(np.array(added, np.int64))
    return _each_once(np.vstack(found), n)


def _nearest_outside(
    places: Float64, whole: cKDTree, part: NDArray[np.int64], one: int, own: NDArray[np.int64]
) -> tuple[Float64, NDArray[np.int64]]:
    """(K,) from each row of a part to the nearest row of any other within `BRIDGE_CM`, infinite where there is none.

    A cloud of a room falls into thousands of small parts. A small part queries the tree of all places for more
    neighbours than it has places, so only large parts need a tree of the rest.
    """
    if len(own) <= SMALL_PART:
        k = min(len(own) + 1, len(places))
        distances, nearest = whole.query(places[own], k=[*range(1, k + 1)], distance_upper_bound=BRIDGE_CM)
        outside = np.isfinite(distances) & (np.append(part, one)[nearest] != one)
        first = outside.argmax(axis=1)
        rows = np.arange(len(own))
        return np.where(outside.any(axis=1), distances[rows, first], np.inf), nearest[rows, first]
    rest = np.flatnonzero(part != one)
    distances, nearest = cKDTree(places[rest]).query(places[own], distance_upper_bound=BRIDGE_CM)
    return distances, np.append(rest, -1)[nearest]


def path_to(tree: WoodTree, row: int, stop: NDArray[np.bool_]) -> list[int]:
    """Rows from the first one of `stop` (or the root) outwards to `row`."""
    path = [row]
    while not stop[path[-1]] and tree.before[path[-1]] >= 0:
        path.append(int(tree.before[path[-1]]))
    return path[::-1]


class MergedNumbers:
    """Numbers that can be merged: those of one group count as the same."""

    def __init__(self) -> None:
        self._above: list[int] = []

    def new(self) -> int:
        self._above.append(len(self._above))
        return self._above[-1]

    def of(self, number: int) -> int:
        while self._above[number] != number:
            number = self._above[number]
        return number

    def merge(self, one: int, other: int) -> None:
        self._above[self.of(other)] = self.of(one)
