# SPDX-License-Identifier: Apache-2.0
"""Size and outliers of the point set of a boll, relative to the set itself: no unit of length is known yet."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32

MIN_GAUSSIANS: Final = 10
"""Least number of Gaussians in an object (the seed paper's min_samples)."""


def measure_extent(points: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middle and size of a point set along its principal axes.

    Returns:
        centre (3,) and the widths (3,), longest first, between the 2nd and 98th percentile: a boll that is dense on one
        side has its centre in the middle all the same.
    """
    points = np.asarray(points, np.float64)
    mean = points.mean(axis=0)
    axes = np.linalg.svd(np.cov((points - mean).T) if len(points) > 1 else np.eye(3))[2]
    low, high = np.percentile((points - mean) @ axes.T, (2, 98), axis=0)
    return mean + (low + high) / 2 @ axes, np.sort(high - low)[::-1]


def find_compact_part(points: NDArray[Any]) -> NDArray[np.bool_]:
    """Which points form the body: the largest connected part without far-off stragglers.

    Points are connected within the larger of 2.5 times the median distance to the third neighbour and a tenth of the
    median distance from the centre; stragglers are more than 3.5 robust standard deviations (MAD) farther from the
    centre than the median.
    """
    from scipy import sparse
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    points = np.asarray(points, np.float64)
    kept = np.ones(len(points), bool)
    if len(points) < 4:
        return kept
    tree = cKDTree(points)
    spacing = np.median(tree.query(points, k=4)[0][:, 3])
    distances = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    pairs = tree.query_pairs(max(2.5 * spacing, 0.1 * float(np.median(distances))), output_type="ndarray")
    graph = sparse.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(points),) * 2)
    parts = connected_components(graph, directed=False)[1]
    kept = parts == np.bincount(parts).argmax()
    body = points[kept]
    distances = np.linalg.norm(points - measure_extent(body)[0], axis=1)
    middle = np.median(distances[kept])
    spread = 1.4826 * np.median(np.abs(distances[kept] - middle))
    compact: NDArray[np.bool_] = kept & (distances <= middle + 3.5 * max(spread, 0.05 * middle))
    return compact


def find_nearest(points: Float32, middles: Float32, sizes: Float32, reach: float) -> NDArray[np.uint16]:
    """(N,) number, from 1, of the middle (B, D) nearest to each point (N, D), in diameters (B,) of the boll;
    0 = none within reach."""
    from scipy.spatial import cKDTree

    if not len(middles) or not len(points):
        return np.zeros(len(points), np.uint16)
    # The nearest in their own diameters is among the nearest few.
    distances, which = cKDTree(middles).query(points, k=min(6, len(middles)))
    distances, which = distances.reshape(len(points), -1), which.reshape(len(points), -1)
    relative = distances / sizes[which]
    best = relative.argmin(axis=1)
    rows = np.arange(len(points))
    return np.where(relative[rows, best] < reach, which[rows, best] + 1, 0).astype(np.uint16)


def weighted_median(values: Float32, weights: Float32) -> float:
    """The value that has half of the weight at either side."""
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(share, 0.5 * share[-1])]])
