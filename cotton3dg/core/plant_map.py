# SPDX-License-Identifier: Apache-2.0
"""The map of a plant: its stem, its branches in order, and the place of each boll on them.

Lengths are cm in the plant frame: z up from the table top, the origin where the stem meets the table.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from .scene import Float64

KINDS: Final = ("stem", "fruiting", "vegetative")
DOUBTFUL: Final = 0.7
"""Confidence below which a place on the map is worth a look."""


@dataclass(frozen=True)
class Axis:
    """The stem or a branch."""

    rank: int
    """0 of the stem; branches 1, 2, ... by the height of their feet, from below."""
    kind: str
    """One of `KINDS`."""
    parent: int
    """Rank of the axis that it grows on; -1 of the stem."""
    curve: Float64
    """(N, 3) cm, from its foot on the parent's centre line to its tip or to the foot of its last boll."""
    radii: Float64
    """(N,) cm; NaN where no silhouette shows it."""
    confidence: float
    """0..1, share of its length that wood was seen along."""
    bolls: tuple[int, ...] = ()
    """Ids of the bolls on it, outwards."""


@dataclass(frozen=True)
class BollOnMap:
    """Where a boll sits."""

    boll_id: int
    branch: int
    """Rank of its branch; 0 = the stem itself."""
    rank: int
    """1, 2, ... of the bolls on that branch, outwards."""
    stalk: Float64
    """(N, 3) cm, from the node on the branch's centre line to the foot of the boll."""
    path_cm: float
    """Along the branch from the stem's centre line to the node."""
    position: int
    """Inferred fruiting position: 1, 2 or 3, which is 3 and beyond; 0 = not inferred."""
    position_confidence: float
    """0..1; NaN without a position."""
    confidence: float
    """0..1, that this is its branch: it depends on how much nearer the branch is to its foot than another one, and on
    whether branches may have been mixed up on the way there."""

    @property
    def doubtful(self) -> bool:
        """Whether another branch may well be its own."""
        return self.confidence < DOUBTFUL


@dataclass(frozen=True)
class PlantMap:
    """The whole map; it has no axes if no stem was found."""

    axes: tuple[Axis, ...]
    """The stem, then the branches by rank."""
    bolls: tuple[BollOnMap, ...]
    """Ascending by id, without bolls that are not connected with the stem."""
    reason: str = ""
    """The reason for a missing map."""

    @property
    def stem(self) -> Axis:
        return self.axes[0]

    @property
    def branches(self) -> tuple[Axis, ...]:
        return self.axes[1:]
