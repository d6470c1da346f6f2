# SPDX-License-Identifier: Apache-2.0
"""Which bolls may sit on another branch than in the map, because branches pass near each other.

Where two branches touch, the model's wood is one piece, and bends alone decide which branch goes on where. On simulated
plants one in three bolls beyond such a place is on a wrong branch, and one in fifteen of the others
(docs/notes/plant_map.md).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from ..core.plant_map import Axis, PlantMap
from ..geometry.polylines import nearest_on, path_lengths

NEAR_CM: Final = 1.6
"""Largest distance of centre lines that may be mixed up where they pass each other."""
BESIDE_STEM_CM: Final = 1.5
"""Length of a branch from its foot within which other branches that leave the stem do not cause a doubt, ..."""
FORK_CM: Final = 2.0
"""... and the same length for its own branches, from their feet."""
BEYOND_CM: Final = 2.5
"""Distance beyond a boll's node within which its branch may still go astray."""
STILL_RIGHT: Final = 0.67
"""Share of the bolls beyond such a place that are nevertheless on the right branch."""


def lower_confidence(plant_map: PlantMap) -> PlantMap:
    """The map with less confidence in a boll's branch if the branch passes near another one on the way to the boll."""
    by_rank = {axis.rank: axis for axis in plant_map.axes}
    first = {axis.rank: _first_pass_cm(axis, by_rank) for axis in plant_map.branches}
    bolls = []
    for boll in plant_map.bolls:
        sure = STILL_RIGHT if _may_be_mixed_up(boll.branch, boll.path_cm, by_rank, first) else 1.0
        bolls.append(replace(boll, confidence=sure * boll.confidence))
    return replace(plant_map, bolls=tuple(bolls))


def _may_be_mixed_up(rank: int, length_cm: float, by_rank: dict[int, Axis], first: dict[int, float]) -> bool:
    """Whether the way from the stem to a place on a branch passes near another branch."""
    while rank > 0:
        if first[rank] <= length_cm + BEYOND_CM:
            return True
        axis = by_rank[rank]
        rank = axis.parent
        length_cm = float(nearest_on(by_rank[rank].curve, axis.curve[:1])[1][0])
    return False


def _first_pass_cm(axis: Axis, by_rank: dict[int, Axis]) -> float:
    """Path length at which a branch first passes near one that it does not grow on; infinite where it never does."""
    lengths = path_lengths(axis.curve)
    bearers = _bearers(axis, by_rank)
    first = np.inf
    for other in by_rank.values():
        if other.rank in bearers:
            continue
        away, stations = nearest_on(other.curve, axis.curve)
        near = (away < NEAR_CM) & (lengths > BESIDE_STEM_CM)
        if other.parent == axis.rank:
            near &= stations > FORK_CM
        first = min(first, float(lengths[near].min(initial=np.inf)))
    return first


def _bearers(axis: Axis, by_rank: dict[int, Axis]) -> set[int]:
    """The axis itself and all axes on which it grows, the stem included."""
    ranks = {axis.rank}
    while axis.parent >= 0:
        axis = by_rank[axis.parent]
        ranks.add(axis.rank)
    return ranks
