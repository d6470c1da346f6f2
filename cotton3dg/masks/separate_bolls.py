"""Bolls told apart by the votes of all views: those that stand alone, and those that lie deep in each other.

The votes for a boll that lies deep in another make a slope of its peak rather than one of their own, and both together
are hardly wider than one. So where bolls touch each other all over a plant, the votes that no middle explains are
looked at again by themselves, and parts are joined less readily. Where bolls stand apart, the same would part the locks
of large ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .join_parts import FITS, join_parts
from .lint_in_space import LintInSpace
from .meeting_votes import FARTHEST, Middles, Votes, drop_unlikely, find_middles

NEIGHBOUR: Final = 1.2
"""Distance, in mean diameters, up to which two bolls may touch."""
CROWDED: Final = 0.3
"""Share of the bolls with a neighbour from which a plant is crowded: it was 0 on five path-traced plants whose bolls
stand apart, and 0.58 to 0.93 on seven plants most of whose bolls touch."""
FITS_IN_CROWDS: Final = 1.4
"""`FITS` of crowded plants."""
EXPLAINED: Final = 0.25
"""Distance, in diameters, from a middle up to which a ray needs no other: twice as far would explain most votes for a
boll next to it."""
LOOKS_AGAIN: Final = 3
HIDDEN_SUPPORT: Final = 0.08
"""Sum of the votes, in bolls seen whole, a view, for a boll that only unexplained votes are for ..."""
HIDDEN_APART: Final = 0.4
"""... and its least distance, in mean diameters, from all others."""


def separate_bolls(votes: Sequence[Votes], lint: LintInSpace, cm_per_su: float | None = None) -> Middles:
    """The bolls of a plant.

    Args:
        votes: of each view.
        cm_per_su: length of a scene unit; None = unknown. Widths are relative to the plant's own either way.
    """
    parts = find_middles(votes)
    bolls = join_parts(parts, votes, lint, FITS)
    if is_crowded(bolls):
        # Middles that are near to each other are those of bolls here.
        bolls = join_parts(find_hidden(parts, votes), votes, lint, FITS_IN_CROWDS, close=-np.inf)
    return drop_unlikely(bolls, votes)


def is_crowded(bolls: Middles) -> bool:
    """Whether many bolls may touch another."""
    if len(bolls.centres) < 2:
        return False
    away = np.linalg.norm(bolls.centres[:, None] - bolls.centres, axis=2)
    np.fill_diagonal(away, np.inf)
    sizes = 0.5 * (bolls.diameters[:, None] + bolls.diameters)
    return bool((away < NEIGHBOUR * sizes).any(axis=1).mean() > CROWDED)


def find_hidden(middles: Middles, votes: Sequence[Votes]) -> Middles:
    """The middles, and those that the votes meet in that none of them explains."""
    for _ in range(LOOKS_AGAIN):
        others = find_middles([view.take(~find_explained(view, middles)) for view in votes])
        away = np.linalg.norm(others.centres[:, None] - middles.centres, axis=2)
        sizes = 0.5 * (others.diameters[:, None] + middles.diameters)
        hidden = (others.support > HIDDEN_SUPPORT * len(votes)) & (away > HIDDEN_APART * sizes).all(axis=1)
        if not hidden.any():
            break
        middles = middles.and_also(others.take(hidden))
    return middles


def find_explained(view: Votes, middles: Middles) -> NDArray[np.bool_]:
    """Which rays (N,) pass a middle whose boll their lint may be of."""
    explained = np.zeros(len(view.rays), bool)
    for centre, diameter in zip(middles.centres, middles.diameters, strict=True):
        near = np.flatnonzero(np.linalg.norm(view.surfaces - centre, axis=1) < FARTHEST * diameter)
        to, rays = centre - view.eye, view.rays[near]
        explained[near] |= np.linalg.norm(to - (rays @ to)[:, None] * rays, axis=1) < EXPLAINED * diameter
    return explained
