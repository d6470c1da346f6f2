# SPDX-License-Identifier: Apache-2.0
"""Joins the parts of one boll that the votes took for several: locks that hang apart, sides that no view sees together.

The likeliest pair joins first, and its measures are taken anew. A pair that is left over is likelier two bolls than
one, and keeps its probability.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from .boll_parts import Part, join_two, measure_pair
from .same_boll import PairMeasures

REACH_CM: Final = 8.0
"""Farthest distance of the middles of two parts of one boll."""

Pairs = dict[tuple[int, int], float]
"""Rows a < b of parts near each other, and the probability that both are one boll."""


@dataclass(frozen=True)
class Joined:
    """The parts with those of one boll made one."""

    parts: dict[int, Part]
    pairs: Pairs
    """The pairs that are left."""
    joins: dict[int, float]
    """For each part that others joined, the least probability that one of them belongs there."""

    def one_boll(self, part: int) -> float:
        """The probability that a part is all of one boll and of no other."""
        apart = math.prod(1 - likely for pair, likely in self.pairs.items() if part in pair)
        return self.joins.get(part, 1.0) * apart


def join_parts(parts: Mapping[int, Part], cm_per_su: float, likely: Callable[[PairMeasures], float]) -> Joined:
    """Join while any pair is likelier one boll than two.

    Args:
        parts: by number.
        likely: the probability that two parts are one boll.
    """
    parts, pairs, joins = dict(parts), Pairs(), dict[int, float]()
    changed = set(parts)
    while True:
        pairs = {
            (a, b): likely(measure_pair(parts[a], parts[b], cm_per_su)) if changed & {a, b} else pairs[a, b]
            for a, b in find_near_pairs(parts, REACH_CM / cm_per_su)
        }
        best = max(pairs, key=lambda pair: (pairs[pair], pair), default=None)
        if best is None or pairs[best] < 0.5:
            return Joined(parts, pairs, joins)
        a, b = best
        joins[a] = min(pairs[best], joins.get(a, 1.0), joins.pop(b, 1.0))
        parts[a] = join_two(parts[a], parts.pop(b))
        changed = {a}


def find_near_pairs(parts: Mapping[int, Part], reach: float) -> list[tuple[int, int]]:
    """Rows a < b of parts whose middles are nearer to each other than `reach`, su."""
    from scipy.spatial import cKDTree

    rows = sorted(parts)
    if not rows:
        return []
    pairs = cKDTree(np.array([parts[row].centre for row in rows])).query_pairs(reach)
    return sorted((rows[a], rows[b]) for a, b in pairs)
