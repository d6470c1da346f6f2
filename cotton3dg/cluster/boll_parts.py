# SPDX-License-Identifier: Apache-2.0
"""Parts of bolls: the lint and the votes at each place where votes meet, and the measures of a pair of parts.

Each Gaussian of lint and each vote belongs to the nearest part. A joined part keeps those of both parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from ..core.scene import Float32, Float64
from .hough_voting import Middles, Votes, meet_rays
from .lint_in_space import LintInSpace
from .same_boll import PairMeasures
from .split_parts import PlacedVotes, fit_mixture

MOST_RAYS: Final = 400
"""Number of rays that a part keeps. More rays do not make a middle sharper."""


@dataclass(frozen=True, eq=False)
class Part:
    """One part, or several that were joined."""

    centre: Float64
    """(3,) su, where its votes meet."""
    diameter: float
    """Diameter of its boll by the votes, su."""
    support: float
    """Sum of the votes of all views; a view that sees the boll whole adds 1."""
    views: int
    """Number of views with votes for it."""
    lint: Float32
    """(n, 3) places of its Gaussians, su."""
    places: Float32
    rays: Float32
    """(m, 3) su each: the middles that some of its votes are for, and the rays of these votes."""
    weights: Float32
    """(m,) weights of these votes; their sum is 1."""

    @cached_property
    def lint_middle(self) -> Float64:
        """(3,) su, mean of its lint; without lint, where its votes meet."""
        return self.lint.mean(axis=0, dtype=np.float64) if len(self.lint) else self.centre


def gather_parts(middles: Middles, votes: Sequence[Votes], lint: LintInSpace) -> dict[int, Part]:
    """Row of `middles` -> its part. Middles without a vote of their own have no part."""
    places = lint.gaussians.means[lint.rows]
    owners = middles.nearest(places)
    owned = np.concatenate([middles.nearest(view.surfaces) for view in votes])
    names = ("places", "rays", "weights")
    aims, rays, weights = (np.concatenate([getattr(view, name) for view in votes]) for name in names)
    parts = {}
    for k in range(len(middles.centres)):
        rows = np.flatnonzero(owned == k + 1)
        if not len(rows):
            continue
        rows = rows[:: -(-len(rows) // MOST_RAYS)]
        parts[k] = Part(
            centre=middles.centres[k].astype(np.float64),
            diameter=float(middles.diameters[k]),
            support=float(middles.support[k]),
            views=int(middles.views[k]),
            lint=places[owners == k + 1],
            places=aims[rows],
            rays=rays[rows],
            weights=weights[rows] / weights[rows].sum(),
        )
    return parts


def join_two(a: Part, b: Part) -> Part:
    """Both parts as one, at the point that the rays of both pass nearest."""
    share = a.support / (a.support + b.support)
    diameter = max(a.diameter, b.diameter)
    places, rays = np.concatenate([a.places, b.places]), np.concatenate([a.rays, b.rays])
    weights = np.concatenate([share * a.weights, (1 - share) * b.weights])
    return Part(
        centre=meet_rays(places, rays, weights, share * a.centre + (1 - share) * b.centre, diameter),
        diameter=diameter,
        support=a.support + b.support,
        views=max(a.views, b.views),
        lint=np.concatenate([a.lint, b.lint]),
        places=places,
        rays=rays,
        weights=weights,
    )


def measure_pair(one: Part, other: Part, up: Float64, cm_per_su: float) -> PairMeasures:
    """The measures of a pair of parts; `up` (3,) points upwards in the scene."""
    apart, upwards = one.lint_middle - other.lint_middle, np.asarray(up) / np.linalg.norm(up)
    return PairMeasures(
        sideways_cm=float(np.linalg.norm(np.cross(apart, upwards))) * cm_per_su,
        below_cm=float(abs(apart @ upwards)) * cm_per_su,
        two_middles=gain_of_two(one, other),
    )


def gain_of_two(one: Part, other: Part) -> float:
    """By how much the mean log likelihood of the votes grows when two middles explain them instead of one."""
    share = one.support / (one.support + other.support)
    votes = PlacedVotes.of(
        np.concatenate([one.places, other.places]),
        np.concatenate([one.rays, other.rays]),
        np.concatenate([share * one.weights, (1 - share) * other.weights]),
    )
    both, diameter = np.stack([one.centre, other.centre]), max(one.diameter, other.diameter)
    middle = np.average(both, axis=0, weights=[share, 1 - share])
    variance = float(votes.weights @ votes.distances2(middle)) / 3
    two, alone = (fit_mixture(votes, centres, variance, diameter) for centres in (both, middle[None]))
    return two.log_likelihood - alone.log_likelihood
