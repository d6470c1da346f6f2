# SPDX-License-Identifier: Apache-2.0
"""Divides point sets into bolls by their shape, and numbers bolls. All lengths are relative to the plant's usual boll,
because the scale may be unknown."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from ..core.bolls import BollInstance
from ..core.scene import Float64
from ..geometry.convex_measures import convex_volume
from ..geometry.point_sets import MIN_GAUSSIANS, measure_extent

SEPARATION: Final = 0.75
"""Distance of two bolls' centres in units of their widths: 1 when balls touch, 0.85 when they are sunk into each other,
0.5 for the halves of one ball. Open bolls of few, large Gaussians reach 0.9, so only wide sets are tested."""

CLOSE: Final = 0.85
"""Distance, in usual widths, below which two bolls may be one: halves of a boll were 0.7 and 0.8 apart, bolls 0.9."""

MOST_PIECES: Final = 8
"""Largest number of bolls into which a set is divided. In larger heaps the inner bolls show too little."""
SEEDINGS: Final = 6
"""Number of starts for each number of pieces. A single start is now and then a bad one."""


def split_heap(points: Float64, usual_width: float) -> NDArray[np.int64] | None:
    """Divide a set that is several bolls in a row or heap.

    Gaussians lie on the surfaces of bolls. A number of pieces is possible if all pieces have an ordinary size and lie
    as far apart as touching bolls do. Among the possible numbers the function takes the one whose pieces are the
    roundest shells: with too few pieces some hold two bolls, with too many some are caps of a ball.

    Args:
        points: (n, 3).
        usual_width: longest width of an ordinary boll, same unit.
    Returns:
        (n,) piece of each point, 2 to `MOST_PIECES`; None when no number is right.
    """
    points = np.asarray(points, np.float64)
    best, least = None, np.inf
    for count in range(2, _most_pieces(points, usual_width) + 1):
        labels = _part(points, count)
        if not _like_bolls(points, labels, usual_width):
            continue
        labels = _lloyd(points, labels, sized=True)
        roughness = _roughness(points, labels)
        if roughness < least:
            best, least = labels, roughness
    return best


def number_bolls(bolls: list[BollInstance], up: Float64) -> list[BollInstance]:
    """The bolls from the top downwards with ids 1, 2, ..."""
    ordered = sorted(bolls, key=lambda boll: (-float(boll.centre @ up), *boll.centre))
    return [replace(boll, boll_id=boll_id) for boll_id, boll in enumerate(ordered, 1)]


def flag_close(bolls: list[BollInstance]) -> list[BollInstance]:
    """The same bolls, with a flag `close` on those that may be one boll with a neighbour."""
    if len(bolls) < 2:
        return bolls
    centres = np.array([boll.centre for boll in bolls])
    apart = cdist(centres, centres)
    np.fill_diagonal(apart, np.inf)
    close = apart.min(axis=1) < CLOSE * np.median([boll.diameter_su for boll in bolls])
    return [
        replace(boll, flags=(*boll.flags, "close")) if near else boll for boll, near in zip(bolls, close, strict=True)
    ]


def _most_pieces(points: Float64, usual_width: float) -> int:
    """Largest number of bolls in a set: one and a half times as many as its hull has room for."""
    # Three balls are at least 1.9 times as wide as one; the quarters of one large ball would pass for bolls.
    if measure_extent(points)[1][0] <= 1.7 * usual_width:
        return 2
    volume = convex_volume(points).value
    return min(MOST_PIECES, max(2, int(1.5 * volume / (np.pi / 6 * usual_width**3)))) if volume > 0 else 2


def _like_bolls(points: Float64, labels: NDArray[np.int64], usual_width: float) -> bool:
    """Whether the pieces are each of ordinary size and lie as far apart as touching bolls do."""
    count = int(labels.max()) + 1
    # A touching boll of half the width still has a fifth of the pair's surface; smaller pieces are stragglers.
    if np.bincount(labels, minlength=count).min() < max(MIN_GAUSSIANS, 0.3 / count * len(points)):
        return False
    centres, widths = zip(*(measure_extent(points[labels == k]) for k in range(count)), strict=True)
    longest = np.array(widths)[:, 0]
    gaps = np.linalg.norm(np.array(centres)[:, None] - centres, axis=2)
    apart = 2 * gaps / (longest + longest[:, None]) + np.eye(count)
    return bool(apart.min() > SEPARATION and longest.max() < 1.4 * usual_width and longest.min() > 0.5 * usual_width)


def _roughness(points: Float64, labels: NDArray[np.int64]) -> float:
    """Sum over the points of the squared distance from their piece's shell, in its radii."""
    total = 0.0
    for k in range(labels.max() + 1):
        part = points[labels == k]
        distances = np.linalg.norm(part - measure_extent(part)[0], axis=1)
        total += float(((distances / max(float(np.median(distances)), 1e-30) - 1) ** 2).sum())
    return total


def _part(points: Float64, count: int) -> NDArray[np.int64]:
    """The tightest of the parts that Lloyd's algorithm makes from several seedings; a pair needs only one."""
    outermost = np.argsort(np.linalg.norm(points - points.mean(axis=0), axis=1), kind="stable")[::-1]
    firsts = outermost[np.linspace(0, len(points) // 2, SEEDINGS if count > 2 else 1).astype(int)]
    trials = [_lloyd(points, _seed(points, count, int(first)), sized=False) for first in firsts]
    return min(trials, key=lambda labels: _spread(points, labels))


def _spread(points: Float64, labels: NDArray[np.int64]) -> float:
    """Sum of the squared distances from the means of the parts."""
    parts = [points[labels == k] for k in np.unique(labels)]
    return float(sum(((part - part.mean(axis=0)) ** 2).sum() for part in parts))


def _seed(points: Float64, count: int, first: int) -> NDArray[np.int64]:
    """Nearest seed of each point. Each seed is the point farthest from the seeds before it; nothing is random."""
    seeds = [first]
    while len(seeds) < count:
        seeds.append(int(cdist(points, points[seeds]).min(axis=1).argmax()))
    nearest: NDArray[np.int64] = cdist(points, points[seeds]).argmin(axis=1)
    return nearest


def _lloyd(points: Float64, labels: NDArray[np.int64], *, sized: bool) -> NDArray[np.int64]:
    """Lloyd's algorithm from given pieces.

    The plain form tells one ball from two. The sized form measures distances in radii of each piece. It cuts balls of
    different size where they touch, but it would also cut a cap off a single ball.
    """
    for _ in range(30):
        parts = [points[labels == k] for k in range(labels.max() + 1)]
        if min(map(len, parts)) < MIN_GAUSSIANS:
            break
        distances = cdist(points, [measure_extent(part)[0] if sized else part.mean(axis=0) for part in parts])
        radii = [max(float(np.median(distances[labels == k, k])), 1e-30) for k in range(len(parts))] if sized else 1.0
        moved = (distances / radii).argmin(axis=1)
        if np.array_equal(moved, labels):
            break
        labels = moved
    return labels
