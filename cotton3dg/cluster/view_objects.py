# SPDX-License-Identifier: Apache-2.0
"""Objects of single views: the Gaussians that one mask holds, bolls made of these, and the masks that show a boll."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from ..core.bolls import BollInstance, LiftedMasks
from ..core.scene import Float64
from ..geometry.point_sets import MIN_GAUSSIANS, find_compact_part, measure_extent
from .boll_shape import number_bolls

OTHER_WEIGHT: Final = 0.5
"""A mask belongs to a boll whose weight in it is more than this many times the weight of all that is not a boll."""
LEAST_CONFIDENCE: Final = 0.2
"""Least share of views that find a boll among those that could. Groups that fewer views find are crumbs of halved and
hidden masks."""


@dataclass(frozen=True)
class ViewObject:
    """The part of a boll that one mask shows."""

    view: int
    """Index among the views of the lifted masks."""
    rows: NDArray[np.int64]
    """(n,) its Gaussians."""
    weights: NDArray[np.float32]
    """(n,) px."""


def find_objects(lifted: LiftedMasks, points: Float64) -> list[ViewObject]:
    """One object for each mask with at least 10 Gaussians: those with half of their weight in it, without stragglers.

    Args:
        points: (N, 3) su, of all Gaussians.
    """
    objects = []
    for selection in lifted.selections:
        view = lifted.views.index(selection.view)
        seen = lifted.seen[view, np.searchsorted(lifted.candidates, selection.indices)]
        inside = selection.weights >= 0.5 * seen
        rows, weights = selection.indices[inside], selection.weights[inside]
        if len(rows) >= MIN_GAUSSIANS:
            body = find_compact_part(points[rows])
            if body.sum() >= MIN_GAUSSIANS:
                objects.append(ViewObject(view, rows[body], weights[body]))
    return objects


def join_nearest(
    centres: Float64,
    view_of: NDArray[np.int64],
    may_join: Callable[[list[int], list[int]], bool],
) -> list[list[int]]:
    """Members of each group. The two nearest groups join, again and again, unless they share a view.

    Args:
        centres: (M, 3) of the objects; that of a group is the mean of its members'. view_of: (M,)
        may_join: called with the members of two groups that do not share a view.
    """
    members = [[k] for k in range(len(centres))]
    middles = centres.copy()
    distances = cdist(centres, centres)
    distances[view_of[:, None] == view_of] = np.inf
    while np.isfinite(distances).any():
        keep, gone = sorted(int(k) for k in np.unravel_index(distances.argmin(), distances.shape))
        if not may_join(members[keep], members[gone]):
            distances[keep, gone] = distances[gone, keep] = np.inf
            continue
        members[keep], members[gone] = members[keep] + members[gone], []
        middles[keep] = centres[members[keep]].mean(axis=0)
        distances[gone] = distances[:, gone] = np.inf
        shared = np.array([bool(m) and not {*view_of[m]}.isdisjoint(view_of[members[keep]]) for m in members])
        fresh = np.linalg.norm(middles - middles[keep], axis=1)
        fresh[shared | np.array([not m for m in members])] = np.inf
        distances[keep] = distances[:, keep] = fresh
    return [group for group in members if group]


def bolls_of_groups(
    groups: Sequence[Sequence[ViewObject]], lifted: LiftedMasks, points: Float64, up: Float64
) -> list[BollInstance]:
    """One boll for each group, numbered from the top downwards.

    A Gaussian that several groups claim goes to the one with the most weight. The confidence is the share of the views
    that see the boll and show it. Groups with less confidence than `LEAST_CONFIDENCE`, or with fewer than 10 Gaussians,
    are left out.

    Args:
        points: (N, 3) su. up: (3,) roughly upwards in the scene; only the numbering depends on it.
    """
    claims = np.zeros((len(groups), len(points)), np.float32)
    for claim, group in zip(claims, groups, strict=True):
        for item in group:
            claim[item.rows] += item.weights
    owners = np.where(claims.max(axis=0, initial=0) > 0, claims.argmax(axis=0) if len(claims) else -1, -1)
    bolls = []
    for number, group in enumerate(groups):
        rows = np.flatnonzero(owners == number)
        rows = rows[find_compact_part(points[rows])]
        names = tuple(lifted.views[view] for view in sorted({item.view for item in group}))
        if len(rows) < MIN_GAUSSIANS:
            continue
        centre, size = measure_extent(points[rows])
        able = (lifted.seen[:, np.searchsorted(lifted.candidates, rows)] > 0).mean(axis=1) >= 0.3
        confidence = min(len(names) / max(int(able.sum()), 1), 1.0)
        if confidence >= LEAST_CONFIDENCE:
            bolls.append(BollInstance(0, rows, names, centre, float(size.mean()), confidence))
    return number_bolls(bolls, up)


def assign_masks(bolls: Sequence[BollInstance], lifted: LiftedMasks, labels: NDArray[np.int32]) -> list[BollInstance]:
    """The same bolls with their masks: those in which no other boll has more weight. Some masks belong to no boll.

    Args:
        labels: (N,) boll of each Gaussian, 0 = none.
    """
    masks: dict[int, list[tuple[str, int]]] = {}
    for selection in lifted.selections:
        held = np.bincount(labels[selection.indices], weights=selection.weights, minlength=2)
        if held[1:].max() > OTHER_WEIGHT * held[0]:
            masks.setdefault(int(held[1:].argmax()) + 1, []).append((selection.view, selection.mask_id))
    return [replace(boll, masks=tuple(masks.get(boll.boll_id, ()))) for boll in bolls]
