# SPDX-License-Identifier: Apache-2.0
"""Joins the masks of single views to bolls: all views together decide which masks show the same boll.

Two masks show the same boll when the views that see both put both into one mask, and different bolls when they put them
into two. This is the view consensus of MaskClustering (Yan et al. 2024). Departures: the views' evidence for and
against a pair is added up as signed edges and contracted greedily (Keuper et al. 2015, GAEC) instead of thresholded
level by level, so that one wrong view cannot chain two bolls together; masks that hold two bolls are recognised by the
views that split them and dropped; the Gaussians vote by weight. Nothing depends on the unit of length.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial.distance import cdist

from ..core.bolls import BollInstance, LiftedMasks
from ..core.scene import Float32, Float64
from ..geometry.point_sets import find_compact_part, measure_extent
from .boll_shape import number_bolls, split_heap

CONSENSUS: Final = 0.7
"""Share of the views that must put two masks into one for them to be one boll. Views err both ways: some masks hold two
touching bolls (say 30 % of them), some only half a boll (5 %)."""
SEEN_SHARE: Final = 0.3
"""A view votes on a set of Gaussians when it sees at least this share of them ..."""
IN_MASK_SHARE: Final = 0.5
"""... and at least this share of the seen ones is in masks; else the detector missed the set, or something hides it."""
CONTAINED_SHARE: Final = 0.8
"""One mask holds the set when it has more than this share of the Gaussians in masks; else the view splits the set."""

FIT_WIDTH: Final = 1.3
"""Two groups fit into one boll when together they are no wider than this many usual widths; touching bolls are 1.4 to
2."""
FIT_EVIDENCE: Final = 1.0
"""Evidence of a fit. It equals three views in favour, or somewhat more than one view against."""

CORE_SHARE: Final = 0.5
"""Share of its weight in a boll's masks that makes a Gaussian the boll's."""
EDGE_SHARE: Final = 0.3
"""... and the share that suffices where no boll has so much: masks often miss the shaded side."""
WIDE: Final = 1.5
"""Bolls this many times as wide as the usual one are divided if their shape is that of several; touching pairs are 1.4
to 2 times as wide, large bolls up to 1.3 times."""
HALVES_APART: Final = 0.78
"""Distance of the centres, in their mean widths, below which two sets are halves of one boll that all masks divide
alike: such halves were up to 0.76 apart, two bolls 0.81 and more."""
LEAST_GAUSSIANS: Final = 5
"""Least number of Gaussians in a mask that takes part, and in a boll. A small boll of a coarse model has at most
twenty, and a set on which several views agree may be small."""
FEW_VIEWS: Final = 3
"""Bolls found by fewer views are flagged: two views may agree by chance."""


class _Votes:
    """Which mask each view puts each candidate in.

    `held` is (F, M) with one at a Gaussian and the mask that has at least half of its weight in that view;
    `visible` is (V, F); `view_of` (M,) and `starts` (V + 1,) give the columns of `held` that belong to a view.
    """

    def __init__(self, lifted: LiftedMasks, heights: Float32):
        position = {view: row for row, view in enumerate(lifted.views)}
        views = np.array([position[s.view] for s in lifted.selections], np.int64)
        rows = [np.searchsorted(lifted.candidates, s.indices) for s in lifted.selections]
        # Mask ids are arbitrary. An order by height makes the breaking of ties independent of them.
        heights_of = np.array(
            [np.average(heights[r], weights=s.weights) for r, s in zip(rows, lifted.selections, strict=True)]
        )
        order = np.lexsort((-heights_of, views))
        sizes = np.array([len(rows[m]) for m in order], np.int64)
        n, m = len(lifted.candidates), len(order)
        self.view_of = views[order]
        self.starts = np.searchsorted(self.view_of, np.arange(len(lifted.views) + 1))
        row = np.concatenate([rows[k] for k in order])
        column = np.repeat(np.arange(m), sizes)
        weight = np.concatenate([lifted.selections[k].weights for k in order])
        self.weights = sparse.csr_matrix((weight, (row, column)), shape=(n, m))
        self.seen = lifted.seen
        # Visibility is relative to the best view, because Gaussians differ in size and opacity.
        self.visible = (lifted.seen >= 0.2 * lifted.seen.max(axis=0)).astype(np.float32)
        most = (weight >= 0.5 * lifted.seen[self.view_of[column], row]) & (self.visible[self.view_of[column], row] > 0)
        self.held = sparse.csr_matrix((np.ones(int(most.sum()), np.float32), (row[most], column[most])), shape=(n, m))

    def verdicts(self, sets: sparse.csr_matrix, usable: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Each view's vote on each set of Gaussians.

        Args:
            sets: (F, C) indicator.
            usable: (M,) masks that may vote.
        Returns:
            (C, V): the mask that holds the set; -1 = the view does not vote; -2 = it splits the set.
        """
        sizes = np.asarray(sets.sum(axis=0)).ravel()
        seen = (self.visible @ sets).T
        verdicts = np.full(seen.shape, -1, np.int64)
        shared = (sets.T @ self.held).tocsc()
        for view in range(seen.shape[1]):
            masks = np.arange(self.starts[view], self.starts[view + 1])
            masks = masks[usable[masks]]
            if not len(masks):
                continue
            inside = shared[:, masks].toarray()
            held, top = inside.sum(axis=1), inside.max(axis=1)
            says = (seen[:, view] >= SEEN_SHARE * sizes) & (held >= np.maximum(IN_MASK_SHARE * seen[:, view], 1))
            whole = top > CONTAINED_SHARE * held
            verdicts[says & whole, view] = masks[inside[says & whole].argmax(axis=1)]
            verdicts[says & ~whole, view] = -2
        return verdicts


def _evidence(verdicts: NDArray[np.int64], n_masks: int) -> Float32:
    """(C, C) signed evidence that two sets are one boll, positive from `CONSENSUS` on.

    Every view that votes on both adds 1 - CONSENSUS if one mask holds both and -CONSENSUS if not.
    """
    says = (verdicts != -1).astype(np.float32)
    c, v = np.nonzero(verdicts >= 0)
    holds = sparse.csr_matrix((np.ones(len(c), np.float32), (c, verdicts[c, v])), shape=(len(verdicts), n_masks))
    evidence: Float32 = (holds @ holds.T).toarray() - CONSENSUS * (says @ says.T)
    return evidence


def contract(evidence: Float32) -> NDArray[np.int64]:
    """Greedy additive edge contraction: join the pair with the strongest evidence, add up its edges, repeat while > 0.

    Args:
        evidence: (C, C) symmetric, overwritten.
    Returns:
        (C,) group of each node, numbered by first member.
    """
    n = len(evidence)
    groups = np.arange(n)
    if n < 2:
        return groups
    np.fill_diagonal(evidence, -np.inf)
    best = evidence.argmax(axis=1)
    strength = evidence[groups, best]
    while True:
        first = int(strength.argmax())
        if not strength[first] > 0:
            break
        keep, gone = sorted((first, int(best[first])))
        groups[groups == gone] = keep
        evidence[keep] += evidence[gone]
        evidence[:, keep] = evidence[keep]
        evidence[gone] = evidence[:, gone] = -np.inf
        strength[gone] = -np.inf
        evidence[keep, keep] = -np.inf
        better = evidence[:, keep] > strength
        best[better], strength[better] = keep, evidence[better, keep]
        stale = np.flatnonzero(((best == gone) | (best == keep)) & ~better & np.isfinite(strength))
        stale = np.union1d(stale, keep)
        best[stale] = evidence[stale].argmax(axis=1)
        strength[stale] = evidence[stale, best[stale]]
    return np.unique(groups, return_inverse=True)[1]


def move_nodes(evidence: Float32, groups: NDArray[np.int64], rounds: int = 20) -> NDArray[np.int64]:
    """Move each node to the group with the strongest evidence for it, until none moves. This repairs early mistakes of
    the greedy contraction."""
    np.fill_diagonal(evidence, 0)
    groups = groups.copy()
    n_groups = int(groups.max(initial=-1)) + 1
    member = np.zeros((len(groups), n_groups), np.float32)
    member[np.arange(len(groups)), groups] = 1
    pull = evidence @ member
    for _ in range(rounds):
        changes = 0
        for node in range(len(groups)):
            old, new = groups[node], int(pull[node].argmax())
            if pull[node, new] > pull[node, old] + 1e-4:
                groups[node] = new
                pull[:, old] -= evidence[:, node]
                pull[:, new] += evidence[:, node]
                changes += 1
        if not changes:
            break
    return groups


def merge_views(lifted: LiftedMasks, means: Float32, up: Float64) -> list[BollInstance]:
    """Bolls on which several views agree.

    Args:
        lifted: masks lifted onto the Gaussians.
        means: (N, 3) su.
        up: (3,) roughly upwards in the scene; only the numbering depends on it.
    Returns:
        bolls numbered from the top downwards; each Gaussian is in at most one. Without masks there are none.
    """
    if not lifted.selections:
        return []
    points = np.asarray(means, np.float64)[lifted.candidates]
    votes = _Votes(lifted, (points @ up).astype(np.float32))
    sizes = np.asarray(votes.held.sum(axis=0)).ravel()
    everyone = np.ones(len(sizes), bool)
    usable = ~_holds_several(votes, votes.verdicts(votes.held, everyone), points)
    nodes = np.flatnonzero(usable & (sizes >= LEAST_GAUSSIANS))
    verdicts = votes.verdicts(votes.held[:, nodes], usable)
    evidence = _evidence(verdicts, len(sizes))
    groups = move_nodes(evidence, contract(evidence.copy()))
    labels, flags = _split_large(_reconcile(votes, usable, nodes, groups, points), points)
    join_halves(labels, flags, points)
    return number_bolls(_make_instances(lifted, votes, usable, labels, flags, points), up)


def _holds_several(votes: _Votes, verdicts: NDArray[np.int64], points: Float64) -> NDArray[np.bool_]:
    """(M,) masks that hold more than one boll: most other views split them, or some do and the mask is large, too."""
    splits = (verdicts == -2).sum(axis=1)
    others = np.maximum((verdicts != -1).sum(axis=1) - 1, 1)
    rate = splits / others
    held = votes.held.tocsc()
    widths = np.array([_width(points[held.indices[held.indptr[m] : held.indptr[m + 1]]]) for m in range(len(rate))])
    usual = np.median(widths[widths > 0]) if (widths > 0).any() else np.inf
    several: NDArray[np.bool_] = (rate > 0.5) | ((rate > 0.12) & (widths > 1.15 * usual))
    return several


def _width(points: Float64) -> float:
    """Longest width of the Gaussians that a mask holds; 0 if they are too few."""
    return float(measure_extent(points)[1][0]) if len(points) >= LEAST_GAUSSIANS else 0.0


def _vote(votes: _Votes, nodes: NDArray[np.int64], groups: NDArray[np.int64], share: float) -> NDArray[np.int64]:
    """(F,) group of each candidate, -1 = none.

    A group of at least two views claims a Gaussian when its masks hold `share` of the Gaussian's weight in its own
    views; of several claims the one with the most weight wins.
    """
    n_masks, n_views = votes.held.shape[1], len(votes.seen)
    n_groups = int(groups.max(initial=-1)) + 1
    if not n_groups:
        return np.full(votes.held.shape[0], -1)
    masks_of = sparse.csr_matrix((np.ones(len(nodes)), (nodes, groups)), shape=(n_masks, n_groups))
    views_of = np.zeros((n_views, n_groups))
    views_of[votes.view_of[nodes], groups] = 1
    held = (votes.weights @ masks_of).toarray()
    seen = votes.seen.T @ views_of
    claims = np.where((held >= share * seen) & (views_of.sum(axis=0) >= 2), held, 0)
    return np.where(claims.max(axis=1) > 0, claims.argmax(axis=1), -1)


def _reconcile(
    votes: _Votes, usable: NDArray[np.bool_], nodes: NDArray[np.int64], groups: NDArray[np.int64], points: Float64
) -> NDArray[np.int64]:
    """Join groups that are parts of one boll, by the Gaussians of all views of each group.

    Halves that no view sees together have no evidence between them; they are joined when they fit into one boll of
    ordinary size, unless views vote against it.

    Returns:
        (F,) group of each candidate, -1 = none.
    """
    while True:
        labels = _vote(votes, nodes, groups, CORE_SHARE)
        names = np.unique(labels[labels >= 0])
        if len(names) < 2:
            break
        sets = sparse.csr_matrix(labels[:, None] == names, dtype=np.float32)
        evidence = _evidence(votes.verdicts(sets, usable), votes.held.shape[1])
        joined = contract(evidence + FIT_EVIDENCE * _find_fitting([points[labels == name] for name in names]))
        if len(np.unique(joined)) == len(names):
            break
        target = np.arange(groups.max() + 1)
        for part in np.unique(joined):
            target[names[joined == part]] = names[joined == part].min()
        groups = target[groups]
    return _claim(votes, nodes, groups)


def _claim(votes: _Votes, nodes: NDArray[np.int64], groups: NDArray[np.int64]) -> NDArray[np.int64]:
    """(F,) group of each candidate, -1 = none. Sure candidates are claimed first, then those at the edges of groups."""
    labels, edge = (_vote(votes, nodes, groups, share) for share in (CORE_SHARE, EDGE_SHARE))
    return np.where((labels < 0) & np.isin(edge, labels[labels >= 0]), edge, labels)


def _find_fitting(parts: list[Float64]) -> NDArray[np.bool_]:
    """(C, C) which pairs of point sets are together at most as wide as an ordinary boll."""
    widths = np.array([measure_extent(part)[1][0] for part in parts])
    order = np.argsort(widths)
    counts = np.cumsum([len(parts[k]) for k in order])
    # The median is weighted by size, because crumbs are many and unrelated to the size of a boll.
    usual = widths[order[np.searchsorted(counts, counts[-1] / 2)]]
    centres = np.array([measure_extent(part)[0] for part in parts])
    near = np.linalg.norm(centres[:, None] - centres, axis=2) < usual
    fits = np.zeros(near.shape, bool)
    for a, b in np.argwhere(np.triu(near, 1)):
        both = measure_extent(np.concatenate([parts[a], parts[b]]))[1][0]
        fits[a, b] = fits[b, a] = both < FIT_WIDTH * usual
    return fits


def _split_large(labels: NDArray[np.int64], points: Float64) -> tuple[NDArray[np.int64], dict[int, str]]:
    """The labels without stragglers and crumbs, with sets of several bolls divided; and flags of the doubtful ones."""
    shaped = np.full(len(labels), -1)
    widths = {}
    for group in np.unique(labels[labels >= 0]):
        rows = np.flatnonzero(labels == group)
        rows = rows[find_compact_part(points[rows])]
        if len(rows) >= LEAST_GAUSSIANS:
            shaped[rows] = group
            widths[int(group)] = measure_extent(points[rows])[1][0]
    flags: dict[int, str] = {}
    usual = float(np.median(list(widths.values()))) if widths else 0.0
    for group, width in widths.items():
        if width > WIDE * usual:
            rows = np.flatnonzero(shaped == group)
            parts = split_heap(points[rows], usual)
            if parts is not None:
                names = np.array([group, *(int(shaped.max()) + np.arange(1, parts.max() + 1))])
                shaped[rows] = names[parts]
                flags |= {int(name): "parted_by_shape" for name in names}
            else:
                flags[group] = "large"
    return shaped, flags


def join_halves(labels: NDArray[np.int64], flags: dict[int, str], points: Float64) -> None:
    """Join, in place, sets that lie too deep in each other to be two bolls; sets divided by shape stay divided.

    Votes do not help here: a method that separates a boll's locks in space masks them separately in every view.
    """
    names = np.unique(labels[labels >= 0])
    sizes = [measure_extent(points[labels == name]) for name in names]
    centres = np.array([centre for centre, _ in sizes]).reshape(-1, 3)
    widths = np.array([axes.mean() for _, axes in sizes])
    joinable = np.array([flags.get(int(name)) != "parted_by_shape" for name in names], bool)
    while joinable.sum() > 1:
        usual = np.maximum((widths[:, None] + widths) / 2, np.finfo(float).tiny)
        apart = np.where(joinable[:, None] & joinable, cdist(centres, centres) / usual, np.inf)
        np.fill_diagonal(apart, np.inf)
        kept, joined = np.unravel_index(apart.argmin(), apart.shape)
        if apart[kept, joined] >= HALVES_APART:
            return
        labels[labels == names[joined]] = names[kept]
        centres[kept], axes = measure_extent(points[labels == names[kept]])
        widths[kept], joinable[joined] = axes.mean(), False
        flags[int(names[kept])] = "joined_by_shape"


def _make_instances(
    lifted: LiftedMasks,
    votes: _Votes,
    usable: NDArray[np.bool_],
    labels: NDArray[np.int64],
    flags: dict[int, str],
    points: Float64,
) -> list[BollInstance]:
    """The labelled sets as bolls, with their size and with the views' votes on each set as a whole."""
    names = np.unique(labels[labels >= 0])
    if not len(names):
        return []
    sets = sparse.csr_matrix(labels[:, None] == names, dtype=np.float32)
    found = votes.verdicts(sets, np.ones(len(usable), bool)) != -1
    verdicts = votes.verdicts(sets, usable)
    bolls = []
    for k, name in enumerate(names):
        rows = labels == name
        centre, widths = measure_extent(points[rows])
        views = tuple(lifted.views[view] for view in np.flatnonzero(found[k]))
        if len(views) < 2:
            continue
        confidence = float((verdicts[k] >= 0).sum() / max((verdicts[k] != -1).sum(), 1))
        doubts = [flags[int(name)]] if int(name) in flags else []
        doubts += ["disputed"] if confidence < 0.5 else []
        doubts += ["few_views"] if len(views) < FEW_VIEWS else []
        diameter = float(widths.mean())
        bolls.append(BollInstance(0, lifted.candidates[rows], views, centre, diameter, confidence, tuple(doubts)))
    return bolls
