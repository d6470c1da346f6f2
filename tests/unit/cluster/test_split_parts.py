# SPDX-License-Identifier: Apache-2.0
"""Parts whose votes meet in two places."""

from dataclasses import replace

import numpy as np
import pytest
from scenes.seen_balls import Ball, see

from cotton3dg.cluster.hough_voting import find_middles
from cotton3dg.cluster.separate_bolls import find_parts
from cotton3dg.cluster.split_parts import PlacedVotes, fit_mixture, fit_two, split_parts

DIAMETER = 4.0
GAIN = 0.25


def scattered(*counts_and_centres: tuple[int, tuple[float, float, float]], spread: float = 0.6) -> PlacedVotes:
    """Votes from all around for some middles, less sure along their rays; every tenth is anywhere near."""
    rng = np.random.default_rng(0)
    aims = np.concatenate([np.tile(centre, (count, 1)) for count, centre in counts_and_centres])
    rays = rng.normal(size=aims.shape)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    places = aims + rng.normal(0, spread, aims.shape) + rays * rng.normal(0, 2 * spread, (len(aims), 1))
    places[::10] += rng.normal(0, 2.0, places[::10].shape)
    return PlacedVotes.of(places, rays, np.ones(len(aims)))


def test_two_middles_without_a_dip_between_them_are_found():
    votes = scattered((450, (0, 0, 0)), (150, (2.0, 0, 0)))
    two, gain = fit_two(votes, DIAMETER)
    assert gain > 0.1
    large, small = two.centres[np.argsort(-two.memberships.sum(axis=0))]
    np.testing.assert_allclose(large, [0, 0, 0], atol=0.2)
    np.testing.assert_allclose(small, [2, 0, 0], atol=0.3)
    np.testing.assert_allclose(two.memberships.sum(axis=1), 1)


def test_one_middle_with_heavy_tails_stays_one():
    _, gain = fit_two(scattered((600, (1, 2, 3))), DIAMETER)
    assert 0 <= gain < 0.5 * GAIN


def test_a_fit_never_becomes_less_likely(monkeypatch):
    votes = scattered((300, (0, 0, 0)), (300, (2.5, 0, 0)))
    likelihoods = []
    for iterations in range(1, 12):
        monkeypatch.setattr("cotton3dg.cluster.split_parts.ITERATIONS", iterations)
        likelihoods.append(fit_mixture(votes, np.array([[0.5, 1, 0], [1.5, -1, 0]]), 4.0, DIAMETER).log_likelihood)
    assert (np.diff(likelihoods) > -1e-9).all()


@pytest.mark.parametrize(
    ("places", "split"),
    [([(0, 0, 0)], False), ([(0, 0, 0), (2, 0, 0)], True), ([(0, 0, 0), (2, 0, 0), (1e6, 0, 0)], True)],
)
def test_votes_that_agree_to_the_last_digit_have_finite_likelihoods(places, split):
    """And a middle that no vote is for is somewhere all the same."""
    rays = np.random.default_rng(0).normal(size=(300, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    votes = PlacedVotes.of(np.resize(np.array(places, float), (300, 3)), rays, np.ones(300))
    with np.errstate(all="raise", under="ignore"):
        two, gain = fit_two(votes, DIAMETER)
        far = fit_mixture(votes, np.array([[0.0, 0, 0], [1e9, 0, 0]]), 1.0, DIAMETER)
    assert np.isfinite(two.centres).all() and np.isfinite(gain) and two.variance > 0
    assert np.isfinite(far.centres).all() and np.isfinite(far.log_likelihood)
    assert (gain > GAIN) == split


def test_the_place_that_rays_say_least_about_is_along_them():
    """Two votes whose rays cross at right angles meet near where they cross, whatever depths they state."""
    rays = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    crossing = PlacedVotes.of(np.array([[3.0, 0, 0], [0, -3.0, 0]]), rays, np.ones(2))
    assert np.abs(crossing.mean(crossing.weights)).max() < 0.5


@pytest.mark.parametrize("unit", [0.05, 1.0, 20.0])
def test_a_boll_deep_in_another_is_found(unit):
    balls = [Ball((0, 0, 0), 2.0), Ball((2.0, 0, 0), 1.6)]
    votes, _ = see(balls, scatter=0.8)
    scaled = [
        replace(view, **{name: unit * getattr(view, name) for name in ("places", "surfaces", "eye", "diameters")})
        for view in votes
    ]
    assert len(find_middles(scaled).centres) == 1, "a peak of its own would need no mixture"
    parts = find_parts(scaled, GAIN)
    assert len(parts.centres) == 2
    np.testing.assert_allclose(sorted(parts.centres[:, 0] / unit), [0, 2.0], atol=0.4)
    assert parts.support.sum() == pytest.approx(find_middles(scaled).support.sum(), rel=1e-3)


def test_a_lone_boll_is_not_split():
    votes, _ = see([Ball((0, 0, 0), 2.3)], scatter=0.8)
    middles = find_middles(votes)
    assert len(split_parts(middles, votes, GAIN).centres) == len(middles.centres) == 1


def test_few_votes_split_nothing():
    votes, _ = see([Ball((0, 0, 0), 2.0), Ball((2.0, 0, 0), 1.6)], scatter=0.8)
    few = [view.take(np.arange(len(view.rays)) % 300 == 0) for view in votes]
    middles = find_middles(votes)
    assert split_parts(middles, few, GAIN) is middles
