"""Which boll lint is of: the one whose middle is near, and which the votes around there are for.

Where bolls lie in each other, the plane half-way between their middles is not where one ends. The network sees that in
each image, and the mean of all images' votes is sharper than one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32
from .meeting_votes import FARTHEST, Middles, Votes

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

SAID: Final = 1.0
"""How much the distance of the votes from a middle counts beside that of the lint itself."""
AROUND: Final = 32
"""Votes that are heard at a place."""
MOST_VOTES: Final = 150_000
"""More would not make their means any sharper."""
VOTES_A_PLACE: Final = 8
"""Votes are heard at every so manieth one's lint, and lint takes what is said at the nearest of these places."""
FARTHEST_VOTE: Final = 1.0
"""Diameters; votes that go farther astray count as this far."""


@dataclass(frozen=True)
class LintOwners:
    """What the votes say of which boll lint is of."""

    middles: Middles
    heard_at: cKDTree
    """Of (S, 3) places, su."""
    said: Float32
    """(S, B) mean distance of the votes around each place from each boll's middle, in its diameters."""

    def at(self, places: Float32) -> NDArray[np.uint16]:
        """(N,) boll that lint at (N, 3) places is of, from 1, 0 = none is near."""
        owners, least = np.zeros(len(places), np.uint16), np.full(len(places), np.inf, np.float32)
        if not len(places) or not self.heard_at.n:
            return owners
        nearest = self.heard_at.query(places)[1]
        for boll, (centre, diameter) in enumerate(zip(self.middles.centres, self.middles.diameters, strict=True)):
            away = np.linalg.norm(places - centre, axis=1) / diameter
            total = away + np.float32(SAID) * self.said[nearest, boll]
            better = (away < FARTHEST) & (total < least)
            owners[better], least[better] = boll + 1, total[better]
        return owners


def hear_votes(votes: Sequence[Votes], middles: Middles) -> LintOwners:
    """Gather what the votes of all views say about the lint that they are of."""
    from scipy.spatial import cKDTree

    step = max(1, sum(len(view.places) for view in votes) // MOST_VOTES)
    surfaces = np.concatenate([view.surfaces for view in votes])[::step]
    aims = np.concatenate([view.places for view in votes])[::step]
    heard_at = surfaces[::VOTES_A_PLACE]
    count = max(min(AROUND, len(surfaces)), 1)
    around = cKDTree(surfaces).query(heard_at, k=count)[1].reshape(len(heard_at), count)
    said = np.empty((len(heard_at), len(middles.centres)), np.float32)
    for boll, (centre, diameter) in enumerate(zip(middles.centres, middles.diameters, strict=True)):
        away = np.linalg.norm(aims - centre, axis=1) / diameter
        said[:, boll] = away.clip(max=FARTHEST_VOTE)[around].mean(axis=1)
    return LintOwners(middles, cKDTree(heard_at), said)
