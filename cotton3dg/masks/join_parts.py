"""Parts of one boll that votes took for several are joined: locks that hang apart, sides that no view sees together.

Two middles are of one boll when the lint of both together is no wider than a boll of this plant may be, or the middles
are very near to each other, and the network sees no border between them. Two bolls that touch are 1.7 to 2 bolls wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32
from .lint_in_space import LintInSpace
from .meeting_votes import FARTHEST, Middles, Votes

FITS: Final = 1.585
"""Largest width of one boll in any direction, in usual mean widths, where the network is undecided of a border ..."""
UNDECIDED: Final = 0.4
"""... as it is with this mean probability of one; by as much as it is surer, ..."""
DIVIDES: Final = 2.0
"""... times this, less width is allowed."""
CLOSE: Final = 0.75
"""Distance of two middles, in usual mean widths, up to which they are of one boll however wide it is, where the network
is undecided of a border; changed by what it says as `FITS` is. Long hanging bolls are so; of 73 pairs of touching bolls
on 21 plants none came nearer than 0.85."""
USUAL: Final = 0.6
"""Quantile of the mean widths of parts that is taken for the width of a boll: some parts are halves, some are no bolls
and wider."""
NEAR: Final = 1.2
"""Farthest distance, in usual widths, of middles that may be of one boll."""
DIRECTIONS: Final = 64
TAIL: Final = 0.02
"""Share of a part's Gaussians at either end that its width leaves out."""


def join_parts(
    middles: Middles, votes: Sequence[Votes], lint: LintInSpace, fits: float = FITS, close: float = CLOSE
) -> Middles:
    """The middles with those of one boll made one, the narrowest pair first.

    Args:
        fits, close: what to take for `FITS` and `CLOSE`; minus infinity = however near, they may be two.
    """
    places = lint.gaussians.means[lint.shares > 0.5]
    places = places[np.isfinite(places).all(axis=1)]
    owners, seen = middles.nearest(places), [middles.nearest(view.surfaces) for view in votes]
    parts = [measure_widths(places[owners == k])[0] for k in range(1, len(middles.centres) + 1)]
    usual = float(np.quantile(parts, USUAL)) if parts else 0.0
    contacts = [find_contacts(view) for view in votes]
    borders = measure_borders(contacts, seen)
    widths: dict[tuple[int, int], float] = {}
    while len(middles.centres) > 1:
        best, pair = 0.0, None
        for a, b in find_near_pairs(middles.centres, NEAR * usual):
            if (a + 1, b + 1) not in borders:
                continue
            if (a + 1, b + 1) not in widths:
                widths[a + 1, b + 1] = measure_widths(places[(owners == a + 1) | (owners == b + 1)])[1]
            apart = float(np.linalg.norm(middles.centres[a] - middles.centres[b]))
            wide = min(widths[a + 1, b + 1] / usual - fits, apart / usual - close)
            score = wide + DIVIDES * (borders[a + 1, b + 1] - UNDECIDED)
            if score < best:
                best, pair = score, (a, b)
        if pair is None:
            break
        # Bolls that the join leaves as they are keep their measures.
        join = Join(middles, *pair)
        middles = join.after
        owners, touched = join.find_owners(owners, places)
        widths = join.keep(widths, touched)
        found = [join.find_owners(ids, view.surfaces) for ids, view in zip(seen, votes, strict=True)]
        seen, touched = [ids for ids, _ in found], np.unique(np.concatenate([ids for _, ids in found]))
        borders = join.keep(borders, touched) | measure_borders(contacts, seen, touched)
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


@dataclass(frozen=True)
class Join:
    """What taking row b of middles into row a changes, and what it leaves as it is."""

    before: Middles
    a: int
    b: int

    @cached_property
    def after(self) -> Middles:
        return join_pair(self.before, self.a, self.b)

    @cached_property
    def names(self) -> NDArray[np.uint16]:
        """(B + 1,) what the bolls, from 1, are called after it."""
        names = np.arange(len(self.before.centres) + 1, dtype=np.uint16)
        names[self.b + 1 :] -= 1
        names[self.b + 1] = self.a + 1
        return names

    def find_owners(self, owners: NDArray[np.uint16], places: Float32) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
        """`after.nearest(places)`, from `before.nearest(places)`, and the bolls that win or lose places.

        Only what lies within reach of a middle that comes or goes can change its owner.
        """
        from scipy.spatial.distance import cdist

        moved = np.concatenate([self.before.centres[[self.a, self.b]], self.after.centres[[self.a]]])
        reach = 1.001 * FARTHEST * self.before.diameters.max()  # rounding has no say in who is looked at
        near = cdist(moved, places).min(axis=0) < reach
        renamed = self.names[owners]
        found = renamed.copy()
        found[near] = self.after.nearest(places[near])
        changed = found != renamed
        return found, np.unique(np.concatenate([[self.a + 1], renamed[changed], found[changed]])).astype(np.uint16)

    def keep(self, measures: dict[tuple[int, int], float], touched: NDArray[np.uint16]) -> dict[tuple[int, int], float]:
        """Measures of pairs of bolls under their new names, without those of touched ones."""
        renamed = {(int(self.names[a]), int(self.names[b])): value for (a, b), value in measures.items()}
        gone = set(touched.tolist())
        return {pair: value for pair, value in renamed.items() if gone.isdisjoint(pair)}


def measure_widths(places: Float32) -> tuple[float, float]:
    """Mean and largest width of points (N, 3) over all directions, without the ends; 0 of none."""
    if not len(places):
        return 0.0, 0.0
    along = (places - places.mean(axis=0)) @ _directions().T
    low, high = np.quantile(along, [TAIL, 1 - TAIL], axis=0)
    return float((high - low).mean()), float((high - low).max())


@dataclass(frozen=True)
class Contacts:
    """Pixels of lint that lie next to each other in one view, in one direction."""

    rows: NDArray[np.int32]
    """(2, C) of the view's votes."""
    borders: Float32
    """(C,) probability of a border at the first of both or next to it."""


def find_contacts(view: Votes) -> tuple[Contacts, Contacts]:
    """Side by side, and one above the other."""
    rows = np.full(view.shape, -1, np.int32)
    border = np.zeros(view.shape, np.float32)
    rows[view.pixels] = np.arange(len(view.surfaces))
    border[view.pixels] = view.borders
    border = cv2.dilate(border, np.ones((5, 5), np.uint8))

    def between(first: tuple[slice, ...], second: tuple[slice, ...]) -> Contacts:
        both = (rows[first] >= 0) & (rows[second] >= 0)
        return Contacts(np.stack([rows[first][both], rows[second][both]]), border[first][both])

    return between(np.s_[:, :-1], np.s_[:, 1:]), between(np.s_[:-1, :], np.s_[1:, :])


def measure_borders(
    contacts: Sequence[tuple[Contacts, Contacts]],
    seen: Sequence[NDArray[np.uint16]],
    touched: NDArray[np.uint16] | None = None,
) -> dict[tuple[int, int], float]:
    """Mean probability of a border along what the views show as one, by pair of bolls a < b, from 1.

    Args:
        contacts: of each view.
        seen: for each view, which boll each row of its votes is of.
        touched: bolls; pairs without any of these are left out. None = all pairs.
    """
    count = 1 + max((int(ids.max(initial=0)) for ids in seen), default=0)
    wanted = np.isin(np.arange(count), np.arange(count) if touched is None else touched)
    total, pixels = np.zeros(count * count), np.zeros(count * count)
    for both, ids in zip(contacts, seen, strict=True):
        for direction in both:
            ends = ids[direction.rows]
            meet = (ends[0] != ends[1]) & (ends > 0).all(axis=0) & wanted[ends].any(axis=0)
            low, high = np.sort(ends[:, meet].astype(np.int64), axis=0)
            total += np.bincount(low * count + high, direction.borders[meet], count * count)
            pixels += np.bincount(low * count + high, minlength=count * count)
    return {divmod(int(pair), count): float(total[pair] / pixels[pair]) for pair in np.flatnonzero(pixels)}


def _directions() -> NDArray[np.float64]:
    """(DIRECTIONS, 3) over half of the sphere: a Fibonacci spiral."""
    k = np.arange(DIRECTIONS)
    z, angle = (k + 0.5) / DIRECTIONS, k * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
