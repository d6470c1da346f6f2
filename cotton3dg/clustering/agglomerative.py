"""Cross-view clustering of the seed paper (Cotton3DGaussians): objects of single views joined by distance.

The paper runs DBSCAN on the points of the four views' objects (eps = 0.3, min_samples = 10, bounding volumes capped at
25,000, all in the model's arbitrary unit) and joins only objects of different views. Departures: whole objects are
joined, nearest first, as in the paper's rule for pairs, but two clusters never join when they share a view, for a rule
on pairs leaks through chains; eps and the cap are multiples of what the masks themselves show, so that no unit of
length matters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from ..core.bolls import BollInstance, LiftedMasks
from ..geometry.point_sets import MIN_GAUSSIANS, find_compact_part, measure_extent
from .boll_shape import numbered

VOLUME_CAP = 3.0
"""Largest bounding volume of a cluster in medians of one mask's, which covers the visible half of a boll."""
LEAST_CONFIDENCE = 0.2
"""Crumbs of halved and hidden masks gather too; whatever fewer than a fifth of the views find that could is no boll."""


def cluster_objects(lifted: LiftedMasks, means: NDArray, up: NDArray, eps: float = 0.6) -> list[BollInstance]:
    """Bolls as clusters of nearby objects of different views.

    Args:
        lifted: masks lifted onto the Gaussians.
        means: (N, 3) su.
        up: (3,) roughly upwards in the scene; only the numbering depends on it.
        eps: farthest distance between the centres of two clusters that join, in median widths of one mask.
    Returns:
        bolls of at least two views, numbered from the top downwards; a Gaussian that several claim goes to the one with
        the most weight.
    """
    points = np.asarray(means, np.float64)
    objects = _objects(lifted, points)
    if not objects:
        return []
    view_of = np.array([view for view, _, _ in objects])
    shapes = [measure_extent(points[rows]) for _, rows, _ in objects]
    centres, widths = np.array([shape[0] for shape in shapes]), np.array([shape[1] for shape in shapes])
    reach, cap = eps * float(np.median(widths[:, 0])), VOLUME_CAP * float(np.median(widths.prod(axis=1)))
    groups = _joined(centres, [rows for _, rows, _ in objects], points, view_of, reach, cap)
    claims = np.zeros((len(groups), len(points)), np.float32)
    views = []
    for claim, members in zip(claims, groups, strict=True):
        for k in members:
            claim[objects[k][1]] += objects[k][2]
        views.append(sorted({int(view_of[k]) for k in members}))
    owners = np.where(claims.max(axis=0, initial=0) > 0, claims.argmax(axis=0) if len(claims) else -1, -1)
    bolls = []
    for group, seen_by in enumerate(views):
        rows = np.flatnonzero(owners == group)
        rows = rows[find_compact_part(points[rows])]
        if len(seen_by) < 2 or len(rows) < MIN_GAUSSIANS:
            continue
        centre, size = measure_extent(points[rows])
        names = tuple(lifted.views[view] for view in seen_by)
        able = (lifted.seen[:, np.searchsorted(lifted.candidates, rows)] > 0).mean(axis=1) >= 0.3
        confidence = min(len(names) / max(int(able.sum()), 1), 1.0)
        if confidence >= LEAST_CONFIDENCE:
            bolls.append(BollInstance(0, rows, names, centre, float(size.mean()), confidence))
    return numbered(bolls, up)


def _objects(lifted: LiftedMasks, points: NDArray) -> list[tuple[int, NDArray[np.int64], NDArray[np.float32]]]:
    """View, Gaussians and weights of each mask: those with half of their weight in it, without stragglers."""
    objects = []
    for selection in lifted.selections:
        view = lifted.views.index(selection.view)
        seen = lifted.seen[view, np.searchsorted(lifted.candidates, selection.indices)]
        inside = selection.weights >= 0.5 * seen
        rows, weights = selection.indices[inside], selection.weights[inside]
        if len(rows) >= MIN_GAUSSIANS:
            body = find_compact_part(points[rows])
            if body.sum() >= MIN_GAUSSIANS:
                objects.append((view, rows[body], weights[body]))
    return objects


def _joined(
    centres: NDArray, rows: list[NDArray[np.int64]], points: NDArray, view_of: NDArray, reach: float, cap: float
) -> list[list[int]]:
    """Members of each cluster: the nearest two join while they are within reach, share no view and fit the cap."""
    members = [[k] for k in range(len(centres))]
    middles = centres.copy()
    distances = cdist(centres, centres)
    distances[(distances > reach) | (view_of[:, None] == view_of)] = np.inf
    while np.isfinite(distances).any():
        keep, gone = sorted(int(k) for k in np.unravel_index(distances.argmin(), distances.shape))
        together = members[keep] + members[gone]
        union = np.unique(np.concatenate([rows[k] for k in together]))
        if measure_extent(points[union])[1].prod() > cap:
            distances[keep, gone] = distances[gone, keep] = np.inf
            continue
        members[keep], members[gone] = together, []
        middles[keep] = centres[together].mean(axis=0)
        distances[gone] = distances[:, gone] = np.inf
        shared = np.array([bool(m) and not {*view_of[m]}.isdisjoint(view_of[together]) for m in members])
        fresh = np.linalg.norm(middles - middles[keep], axis=1)
        fresh[shared | (fresh > reach) | np.array([not m for m in members])] = np.inf
        distances[keep] = distances[:, keep] = fresh
    return [group for group in members if group]
