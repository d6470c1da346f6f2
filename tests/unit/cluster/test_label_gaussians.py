# SPDX-License-Identifier: Apache-2.0
"""Which of two bolls that lie in each other lint is of."""

import numpy as np
import pytest

from cotton3dg.cluster.hough_voting import Middles, Votes
from cotton3dg.cluster.label_gaussians import average_votes

MIDDLES = np.array([[0.0, 0, 0], [0.7, 0, 0]], np.float32)
"""Diameters apart; the plane half-way between them is at 0.35 ..."""
BORDER = 0.15
"""... but the second boll reaches to here."""


def middles() -> Middles:
    return Middles(MIDDLES, np.ones(2, np.float32), np.array([9, 9], np.float32), np.array([12, 12]))


def votes_for(own: np.ndarray, surfaces: np.ndarray, rng: np.random.Generator, spread: float) -> Votes:
    """One view's votes for the boll (N,) that lint at (N, 3) surfaces is of."""
    n = len(own)
    places = (MIDDLES[own] + spread * rng.normal(size=(n, 3))).astype(np.float32)
    eye = np.array([0.0, 0, 9])
    rays = places - eye
    return Votes(
        places=places,
        surfaces=surfaces.astype(np.float32),
        rays=(rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32),
        eye=eye,
        diameters=np.ones(n, np.float32),
        probabilities=np.ones(n, np.float32),
        weights=np.ones(n, np.float32),
    )


@pytest.mark.parametrize("wrong", [0, 0.25])
def test_lint_is_of_the_boll_that_most_votes_around_it_are_for(wrong):
    rng = np.random.default_rng(0)
    surfaces = np.column_stack([rng.uniform(-0.45, 1.15, 6000), rng.uniform(-0.4, 0.4, (6000, 2))])
    own = (surfaces[:, 0] > BORDER).astype(int)
    told = np.where(rng.random(6000) < wrong, 1 - own, own)
    views = [votes_for(told[part], surfaces[part], rng, 0.15) for part in (slice(0, 3000), slice(3000, None))]
    owners = average_votes(views, middles())
    found = owners.at(surfaces.astype(np.float32)) - 1
    nearest = middles().nearest(surfaces.astype(np.float32)) - 1
    assert (nearest == own).mean() < 0.9
    assert (found == own).mean() > 0.95


def test_lint_that_is_far_from_all_bolls_is_of_none():
    rng = np.random.default_rng(0)
    surfaces = rng.uniform(-0.4, 0.4, (100, 3))
    owners = average_votes([votes_for(np.zeros(100, int), surfaces, rng, 0.1)], middles())
    assert owners.at(np.array([[0, 0, 0.1], [0, 0, 1.3]], np.float32)).tolist() == [1, 0]
    assert not owners.at(np.zeros((0, 3), np.float32)).size


def test_no_votes_are_for_nothing():
    rng = np.random.default_rng(0)
    none = Middles(MIDDLES[:0], *(np.zeros(0, np.float32) for _ in "ab"), np.zeros(0, np.int64))
    owners = average_votes([votes_for(np.zeros(0, int), np.zeros((0, 3)), rng, 0.1)], none)
    assert owners.at(np.zeros((5, 3), np.float32)).tolist() == [0] * 5
