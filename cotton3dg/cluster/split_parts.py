# SPDX-License-Identifier: Apache-2.0
"""Splits parts whose votes meet in two places rather than in one.

A boll that lies deep in another makes no peak of its own among the votes, but a mixture of two middles explains them
better than one middle does. Votes have heavy tails, so the mixture is one of t distributions, fitted by expectation
maximisation (Peel and McLachlan 2000, Robust mixture modelling using the t distribution). A vote is `DEPTH_SPREAD`
times less sure along its ray than across it. Both middles have the same spread.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..core.scene import Float32, Float64
from ..geometry.point_sets import weighted_median
from .hough_voting import APART, LEAST_VIEWS, Middles, Votes

MOST_VOTES: Final = 600
"""Number of a part's votes that are used. More would not change a decision."""
LEAST_VOTES: Final = 60
"""Least number of a part's votes for a split; fewer do not determine two places."""
DEPTH_SPREAD: Final = 2.5
SHARPEST: Final = 0.01
"""Least standard deviation of votes, in diameters. It keeps the likelihood of equal votes finite."""
EMPTY: Final = 1e-9
"""Least share of each vote that a middle gets, so that a middle without votes has a place."""
FREEDOM: Final = 3.0
"""Degrees of freedom of the t distributions: the fewer, the heavier their tails."""
ITERATIONS: Final = 12
_ALONG: Final = 1 - DEPTH_SPREAD**-2
START: Final = 0.3
"""Distance, in diameters, between the single middle and each of the two that the fit starts with."""


@dataclass(frozen=True)
class PlacedVotes:
    """Votes of one part: each is an estimate of the middle of its boll."""

    places: Float64
    """(N, 3) su."""
    rays: Float64
    """(N, 3) of unit length, from the eye."""
    weights: Float64
    """(N,) 1 in all."""

    @classmethod
    def of(cls, places: Float32, rays: Float32, weights: Float32) -> PlacedVotes:
        """From weights in any unit."""
        whole = weights.astype(np.float64)
        return cls(places.astype(np.float64), rays.astype(np.float64), whole / whole.sum().clip(min=1e-12))

    def distances2(self, centre: Float64) -> Float64:
        """(N,) squared distances of a centre from each vote, su²; a distance along the ray counts less."""
        away = self.places - centre
        squares: Float64 = np.einsum("ni,ni->n", away, away) - _ALONG * np.einsum("ni,ni->n", away, self.rays) ** 2
        return squares

    def mean(self, weights: Float64) -> Float64:
        """(3,) the place with the least mean of `distances2`, with other weights (N,)."""
        along = np.einsum("ni,ni->n", self.rays, self.places)
        across = weights @ (self.places - _ALONG * along[:, None] * self.rays)
        matrix = weights.sum() * np.eye(3) - _ALONG * (self.rays * weights[:, None]).T @ self.rays
        return np.linalg.solve(matrix, across)


@dataclass(frozen=True)
class Mixture:
    """K middles with one spread."""

    centres: Float64
    """(K, 3) su."""
    variance: float
    """su²."""
    memberships: Float64
    """(N, K) probability that a vote is for each middle."""
    log_likelihood: float
    """Mean of all votes, by weight."""


def fit_mixture(votes: PlacedVotes, centres: Float64, variance: float, diameter: float) -> Mixture:
    """Expectation maximisation.

    Args:
        centres: (K, 3) su, and variance, su², to begin with.
        diameter: of a boll, su.
    """
    shares, least = np.full(len(centres), 1 / len(centres)), (SHARPEST * diameter) ** 2
    variance = max(variance, least)
    for _ in range(ITERATIONS):
        distances2 = np.stack([votes.distances2(centre) for centre in centres], axis=1)
        scaled = distances2 / variance
        log_density = np.log(shares) - 1.5 * np.log(variance) - 0.5 * (FREEDOM + 3) * np.log1p(scaled / FREEDOM)
        likelihood = np.logaddexp.reduce(log_density, axis=1)
        memberships = np.exp(log_density - likelihood[:, None])
        held = votes.weights[:, None] * (memberships + EMPTY)
        trust = held * (FREEDOM + 3) / (FREEDOM + scaled)
        fitted = Mixture(centres, variance, memberships, float(votes.weights @ likelihood))
        centres = np.stack([votes.mean(column) for column in trust.T])
        variance = max(float((trust * distances2).sum() / 3), least)
        shares = held.sum(axis=0)
    return fitted


def fit_two(votes: PlacedVotes, diameter: float) -> tuple[Mixture, float]:
    """The better of two fits of two middles, and by how much its log likelihood exceeds that of one middle.

    Args:
        diameter: of a boll, su.
    """
    middle = votes.mean(votes.weights)
    one = fit_mixture(votes, middle[None], float(votes.weights @ votes.distances2(middle)) / 3, diameter)
    away = votes.places - one.centres[0]
    away -= _ALONG * np.einsum("ni,ni->n", away, votes.rays)[:, None] * votes.rays
    trust = votes.weights / (1 + votes.distances2(one.centres[0]) / (START * diameter) ** 2)
    axes = np.linalg.eigh((away * trust[:, None]).T @ away)[1].T
    starts = (one.centres + START * diameter * np.stack([axis, -axis]) for axis in axes[1:])
    two = max(
        (fit_mixture(votes, start, one.variance, diameter) for start in starts), key=lambda fit: fit.log_likelihood
    )
    return two, two.log_likelihood - one.log_likelihood


def split_parts(middles: Middles, votes: Sequence[Votes], least_gain: float) -> Middles:
    """Replace each middle by two if two explain its votes much better, except where another middle is near already.

    Args:
        least_gain: of a vote's mean log likelihood.
    """
    names = ("surfaces", "places", "rays", "weights", "diameters")
    surfaces, places, rays, weights, diameters = (
        np.concatenate([getattr(view, name) for view in votes]) for name in names
    )
    view_of = np.repeat(np.arange(len(votes)), [len(view.rays) for view in votes])
    owners = middles.nearest(surfaces)
    whole: list[int] = []
    halves: list[tuple[Float64, float, float, int]] = []
    for k, diameter in enumerate(middles.diameters):
        own = np.flatnonzero(owners == k + 1)
        own = own[:: -(-len(own) // MOST_VOTES) or 1]
        two = _split(PlacedVotes.of(places[own], rays[own], weights[own]), float(diameter), least_gain)
        members = [own[two.memberships[:, j] > 0.5] for j in range(2)] if two else []
        if two is None or min(len(np.unique(view_of[rows])) for rows in members) < LEAST_VIEWS:
            whole.append(k)
            continue
        for centre, rows in zip(two.centres, members, strict=True):
            size = weighted_median(diameters[rows], weights[rows])
            away = np.delete(np.linalg.norm(middles.centres - centre, axis=1), k)
            if (away > APART * 0.5 * (size + np.delete(middles.diameters, k))).all():
                share = weights[rows].sum() / weights[own].sum()
                halves.append((centre, size, float(share * middles.support[k]), len(np.unique(view_of[rows]))))
    if not halves:
        return middles
    centres, sizes, support, views = map(np.array, zip(*halves, strict=True))
    both = Middles(centres.astype(np.float32), sizes.astype(np.float32), support.astype(np.float32), views)
    return middles.take(np.array(whole, np.intp)).merged_with(both)


def _split(votes: PlacedVotes, diameter: float, least_gain: float) -> Mixture | None:
    """Two middles, if they explain the votes much better than one."""
    if len(votes.weights) < LEAST_VOTES:
        return None
    two, gain = fit_two(votes, diameter)
    return two if gain > least_gain else None
