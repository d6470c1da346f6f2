# SPDX-License-Identifier: Apache-2.0
"""Alignment of two films of one plant by its bolls alone, if the foot of the stem is only a guess.

Heights count from the table in both films. Each pair of bolls in one film with the same heights and distance as a pair
in the other film proposes a turn and a shift. The module accepts the proposal that lays most bolls on each other,
unless bolls that are each turned at random about their middle do as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..core.scene import Float64
from .match import match_bolls

NEAR_CM: Final = 1.0
ALIKE_CM: Final = 1.5
"""Largest difference in heights and in distances of the same bolls."""
APART_CM: Final = 5.0
"""Bolls that are nearer to each other determine the turn poorly."""
APART_DEG: Final = 20.0
"""Two turns that differ by more count as different."""
FEWEST: Final = 4
MOST_CHANCE: Final = 0.01
LEAST_LEAD: Final = 1.0
"""Least number of bolls or branches that lie on each other at the best turn and not at the second best."""
LEAST_SHARE: Final = 0.5
"""Least share of the bolls and branches of the plant that has fewer that must lie on those of the other plant."""
SHUFFLES: Final = 199


@dataclass(frozen=True)
class BollAlignment:
    """The transformation a = turned b + shift."""

    angle: float
    """About the vertical, rad."""
    shift_cm: Float64
    """(3,)"""
    support: float
    """Number of bolls that lie on each other, each weighted by how near it lies."""
    chance: float


def align_by_bolls(a: Float64, b: Float64) -> BollAlignment | None:
    """Lay (B, 3) centres b on (A, 3) centres a, cm; None if too few bolls support it."""
    a, b = (centres[np.isfinite(centres).all(axis=1)] for centres in (a, b))
    fewer = min(len(a), len(b))
    if fewer < FEWEST:
        return None
    angles, shifts = _proposals(a, b)
    if not len(angles):
        return None
    scores = _scores(a, b, angles, shifts)
    best = int(scores.argmax())
    away = np.abs((angles - angles[best] + np.pi) % (2 * np.pi) - np.pi)
    others = scores[away > np.radians(APART_DEG)]
    angle, shift = _fitted(a, b, angles[best], shifts[best])
    support = float(_scores(a, b, np.array([angle]), shift[None])[0])
    if support < max(FEWEST - 1, LEAST_SHARE * fewer) or support - float(others.max(initial=0.0)) < LEAST_LEAD:
        return None
    rng = np.random.default_rng(0)
    middle = np.append(b[:, :2].mean(axis=0), 0.0)
    beaten = 0
    for _ in range(SHUFFLES):
        turned = _turned(b - middle, rng.uniform(0, 2 * np.pi, len(b))) + middle
        angles, shifts = _proposals(a, turned)
        beaten += int(len(angles) > 0 and _scores(a, turned, angles, shifts).max() >= scores[best])
    chance = (1 + beaten) / (1 + SHUFFLES)
    return BollAlignment(angle, shift, support, chance) if chance <= MOST_CHANCE else None


def _proposals(a: Float64, b: Float64) -> tuple[Float64, Float64]:
    """(P,) turns and (P, 3) shifts that lay two bolls of b on two of a."""
    i, j = (index.ravel() for index in np.meshgrid(np.arange(len(a)), np.arange(len(a)), indexing="ij"))
    k, m = np.triu_indices(len(b), 1)
    way_a, way_b = a[j, :2] - a[i, :2], b[m, :2] - b[k, :2]
    far_a, far_b = np.linalg.norm(way_a, axis=1), np.linalg.norm(way_b, axis=1)
    alike = (
        (np.abs(far_a[:, None] - far_b) <= ALIKE_CM)
        & (far_b > APART_CM)
        & (np.abs(a[i, 2][:, None] - b[k, 2]) <= ALIKE_CM)
        & (np.abs(a[j, 2][:, None] - b[m, 2]) <= ALIKE_CM)
    )
    of_a, of_b = np.nonzero(alike)
    angles = np.arctan2(way_a[of_a, 1], way_a[of_a, 0]) - np.arctan2(way_b[of_b, 1], way_b[of_b, 0])
    shifts = 0.5 * (a[i[of_a]] + a[j[of_a]]) - _turned(0.5 * (b[k[of_b]] + b[m[of_b]]), angles)
    return angles, shifts * (1, 1, 0)


def _scores(a: Float64, b: Float64, angles: Float64, shifts: Float64) -> Float64:
    """(P,) how many bolls of b lie on a after each turn and shift, weighted by how near they lie."""
    placed = np.stack([_turned(b, np.full(len(b), angle)) + shift for angle, shift in zip(angles, shifts, strict=True)])
    squares = ((placed[:, :, None] - a) ** 2).sum(axis=-1).min(axis=2)
    return np.asarray(np.exp(-0.5 * squares / NEAR_CM**2).sum(axis=1))


def _turned(points: Float64, angles: Float64) -> Float64:
    """(N, 3) points, each turned about the vertical by its angle."""
    c, s = np.cos(angles), np.sin(angles)
    x, y, z = points.T
    return np.stack([c * x - s * y, s * x + c * y, z], axis=1)


def _fitted(a: Float64, b: Float64, angle: float, shift: Float64) -> tuple[float, Float64]:
    """Turn and shift from all bolls that match, by least squares."""
    for _ in range(3):
        pairs = match_bolls(a, _turned(b, np.full(len(b), angle)) + shift, 2 * ALIKE_CM)
        to, source = a[pairs[:, 0]], b[pairs[:, 1]]
        t, s = to - to.mean(axis=0), source - source.mean(axis=0)
        angle = float(np.arctan2((s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0]).sum(), (s[:, :2] * t[:, :2]).sum()))
        shift = to.mean(axis=0) - _turned(source, np.full(len(source), angle)).mean(axis=0)
    return angle, shift
