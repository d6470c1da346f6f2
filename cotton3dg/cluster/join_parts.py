# SPDX-License-Identifier: Apache-2.0
"""Joins the parts of one boll that the votes found as several: locks that hang apart, or sides that no view sees
together.

The likeliest pair joins first; then the pairs of the joined part are measured again. A pair that is left is rather two
bolls than one, and its probability is kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..core.scene import Float64
from .boll_parts import Part, join_two, measure_pair
from .same_boll import PairMeasures

REACH_CM: Final = 8.0
"""Farthest distance of the middles of two parts of one boll."""

Pairs = dict[tuple[int, int], float]
"""Rows a < b of parts near each other, and the probability that both are one boll."""


@dataclass(frozen=True)
class Joined:
    """The parts after the joins."""

    parts: dict[int, Part]
    pairs: Pairs
    """The pairs that were not joined."""
    joins: dict[int, float]
    """Joined part -> the least of the probabilities by which others joined it."""

    def one_boll(self, part: int) -> float:
        """The probability that a part is a whole boll and nothing else."""
        apart = math.prod(1 - likely for pair, likely in self.pairs.items() if part in pair)
        return self.joins.get(part, 1.0) * apart


def join_parts(
    parts: Mapping[int, Part], up: Float64, cm_per_su: float, likely: Callable[[PairMeasures], float]
) -> Joined:
    """Join parts while any pair is rather one boll than two.

    Args:
        parts: by number.
        up: (3,) upwards in the scene.
        likely: the probability that two parts are one boll.
    """
    parts, pairs, joins = dict(parts), Pairs(), dict[int, float]()
    changed = set(parts)
    while True:
        pairs = {
            (a, b): likely(measure_pair(parts[a], parts[b], up, cm_per_su)) if changed & {a, b} else pairs[a, b]
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
