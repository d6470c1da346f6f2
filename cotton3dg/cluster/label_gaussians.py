# SPDX-License-Identifier: Apache-2.0
"""Assigns lint to bolls: the middle of the boll is near, and the votes around the lint are for it.

Bolls that lie in each other do not meet at the plane half-way between their middles. The network sees their border in
each image, and the mean of all images' votes shows it more sharply than one image does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32
from .hough_voting import FARTHEST, Middles, Votes

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

AROUND: Final = 32
"""Number of nearest votes that a place averages."""
MOST_VOTES: Final = 150_000
"""Number of votes that are used, about. More do not make the means any sharper."""
VOTES_A_PLACE: Final = 8
"""One vote in this many gives a place at which votes are averaged. Lint takes the mean of the nearest place."""
FARTHEST_VOTE: Final = 1.0
"""Largest distance of a vote from a middle, in diameters. Votes farther off count as this far."""


@dataclass(frozen=True)
class LintOwners:
    """The votes by which lint finds its boll."""

    middles: Middles
    samples: cKDTree
    """Tree of the (S, 3) places at which votes are averaged, su."""
    distances: Float32
    """(S, B) mean distance of the votes around each place from each boll's middle, in diameters of that boll."""

    def at(self, places: Float32) -> NDArray[np.uint16]:
        """Boll (N,) that lint at (N, 3) places belongs to, from 1; 0 = no boll is near."""
        owners, least = np.zeros(len(places), np.uint16), np.full(len(places), np.inf, np.float32)
        if not len(places) or not self.samples.n:
            return owners
        nearest = self.samples.query(places)[1]
        for boll, (centre, diameter) in enumerate(zip(self.middles.centres, self.middles.diameters, strict=True)):
            away = np.linalg.norm(places - centre, axis=1) / diameter
            total = away + self.distances[nearest, boll]
            better = (away < FARTHEST) & (total < least)
            owners[better], least[better] = boll + 1, total[better]
        return owners


def average_votes(votes: Sequence[Votes], middles: Middles) -> LintOwners:
    """Average the votes of all views around the lint that they start from."""
    from scipy.spatial import cKDTree

    step = max(1, sum(len(view.places) for view in votes) // MOST_VOTES)
    surfaces = np.concatenate([view.surfaces for view in votes])[::step]
    aims = np.concatenate([view.places for view in votes])[::step]
    samples = surfaces[::VOTES_A_PLACE]
    count = max(min(AROUND, len(surfaces)), 1)
    around = cKDTree(surfaces).query(samples, k=count)[1].reshape(len(samples), count)
    distances = np.empty((len(samples), len(middles.centres)), np.float32)
    for boll, (centre, diameter) in enumerate(zip(middles.centres, middles.diameters, strict=True)):
        away = np.linalg.norm(aims - centre, axis=1) / diameter
        distances[:, boll] = away.clip(max=FARTHEST_VOTE)[around].mean(axis=1)
    return LintOwners(middles, cKDTree(samples), distances)
