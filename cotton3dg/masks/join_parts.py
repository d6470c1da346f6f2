"""Parts of one boll that votes took for several are joined: locks that hang apart, sides that no view sees together.

Two middles are of one boll when the lint of both together is no wider than a boll of this plant may be, and the network
sees no border between them. Two bolls that touch are 1.7 to 2 bolls wide.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32
from .lint_in_space import LintInSpace
from .meeting_votes import Middles, Votes

FITS = 1.585
"""Largest width of one boll in any direction, in usual mean widths, where the network is undecided of a border ..."""
UNDECIDED = 0.4
"""... as it is with this mean probability of one; by as much as it is surer, ..."""
DIVIDES = 2.0
"""... times this, less width is allowed."""
USUAL = 0.75
"""Quantile of the mean widths of parts that is taken for the width of a boll: some parts are halves."""
NEAR = 1.2
"""Farthest distance, in usual widths, of middles that may be of one boll."""
DIRECTIONS = 64
TAIL = 0.02
"""Share of a part's Gaussians at either end that its width leaves out."""


def join_parts(middles: Middles, votes: Sequence[Votes], lint: LintInSpace) -> Middles:
    """The middles with those of one boll made one, the narrowest pair first."""
    places = lint.gaussians.means[lint.shares > 0.5]
    places = places[np.isfinite(places).all(axis=1)]
    owners = middles.nearest(places)
    parts = [measure_widths(places[owners == k])[0] for k in range(1, len(middles.centres) + 1)]
    usual = float(np.quantile(parts, USUAL)) if parts else 0.0
    while len(middles.centres) > 1:
        borders = measure_borders(middles, votes)
        best, pair = FITS, None
        for a, b in find_near_pairs(middles.centres, NEAR * usual):
            if (a + 1, b + 1) in borders:
                both = places[(owners == a + 1) | (owners == b + 1)]
                score = measure_widths(both)[1] / usual + DIVIDES * (borders[a + 1, b + 1] - UNDECIDED)
                if score < best:
                    best, pair = score, (a, b)
        if pair is None:
            break
        middles = join_pair(middles, *pair)
        owners = middles.nearest(places)
    return middles


def find_near_pairs(centres: Float32, reach: float) -> list[tuple[int, int]]:
    """Pairs a < b of rows (B, 3) that are nearer to each other than `reach`."""
    from scipy.spatial import cKDTree

    return sorted((int(a), int(b)) for a, b in cKDTree(centres).query_pairs(reach))


def join_pair(middles: Middles, a: int, b: int) -> Middles:
    """Row b taken into row a: in the middle of both, by their support."""
    rest = np.delete(np.arange(len(middles.centres)), b)
    weights = middles.support[[a, b]] / middles.support[[a, b]].sum()
    centres, diameters = middles.centres.copy(), middles.diameters.copy()
    support, views = middles.support.copy(), middles.views.copy()
    centres[a] = weights @ centres[[a, b]]
    diameters[a] = diameters[[a, b]].max()
    support[a] += support[b]
    views[a] = views[[a, b]].max()
    return Middles(centres[rest], diameters[rest], support[rest], views[rest])


def measure_widths(places: Float32) -> tuple[float, float]:
    """Mean and largest width of points (N, 3) over all directions, without the ends; 0 of none."""
    if not len(places):
        return 0.0, 0.0
    along = (places - places.mean(axis=0)) @ _directions().T
    low, high = np.quantile(along, [TAIL, 1 - TAIL], axis=0)
    return float((high - low).mean()), float((high - low).max())


def measure_borders(middles: Middles, votes: Sequence[Votes]) -> dict[tuple[int, int], float]:
    """Mean probability of a border along what the views show as one, by pair of bolls a < b, from 1."""
    count = len(middles.centres) + 1
    total, pixels = np.zeros(count * count), np.zeros(count * count)
    for view in votes:
        ids = np.zeros(view.shape, np.uint16)
        border = np.zeros(view.shape, np.float32)
        ids[view.pixels] = middles.nearest(view.surfaces)
        border[view.pixels] = view.borders
        border = cv2.dilate(border, np.ones((5, 5), np.uint8))
        for first, second in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
            meet = (ids[first] != ids[second]) & (ids[first] > 0) & (ids[second] > 0)
            ends = np.sort(np.stack([ids[first][meet], ids[second][meet]]).astype(np.int64), axis=0)
            total += np.bincount(ends[0] * count + ends[1], border[first][meet], count * count)
            pixels += np.bincount(ends[0] * count + ends[1], minlength=count * count)
    return {divmod(int(pair), count): float(total[pair] / pixels[pair]) for pair in np.flatnonzero(pixels)}


def _directions() -> NDArray[np.float64]:
    """(DIRECTIONS, 3) over half of the sphere: a Fibonacci spiral."""
    k = np.arange(DIRECTIONS)
    z, angle = (k + 0.5) / DIRECTIONS, k * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
