# SPDX-License-Identifier: Apache-2.0
"""Lint and the middles of bolls in space, from what the network says in all views."""

import numpy as np
import pytest
from scenes.boll_scene import CENTRES, RADIUS, cameras, maps_of, masks_of, model

from cotton3dg.cluster import hough_voting
from cotton3dg.cluster.boll_images import draw_bolls, without_specks
from cotton3dg.cluster.hough_voting import (
    Middles,
    Votes,
    cast_votes,
    find_middles,
    meet_rays,
)
from cotton3dg.cluster.label_gaussians import average_votes
from cotton3dg.cluster.lint_in_space import LintInSpace
from cotton3dg.cluster.locate_bolls import separate_all
from cotton3dg.cluster.separate_bolls import find_parts, separate_bolls
from cotton3dg.segment.lint_share import gather_lint

UP = np.array([0.0, 0.0, 1.0])


def everything(gaussians) -> np.ndarray:
    return np.ones(len(gaussians), bool)


@pytest.mark.parametrize("noise", [0, 0.15])
def test_votes_meet_in_the_middles_of_the_bolls(noise):
    gaussians, bolls = model()
    rng = np.random.default_rng(0)
    images = masks_of(gaussians, bolls, cameras())
    maps = [maps_of(camera, ids, rng, noise) for camera, ids in zip(cameras(), images, strict=True)]
    lint = LintInSpace.of(gaussians, gather_lint(maps, cameras(), gaussians, everything(gaussians)))
    votes = [cast_votes(view, camera, lint) for view, camera in zip(maps, cameras(), strict=True)]
    middles = find_middles(votes)
    assert len(middles.centres) == len(CENTRES)
    distances = np.linalg.norm(middles.centres[:, None] - CENTRES, axis=2)
    assert (distances.min(axis=1) < 0.1 * RADIUS).all()
    np.testing.assert_allclose(middles.diameters, 2 * RADIUS, rtol=0.15)
    assert (middles.views >= 6).all()
    same = distances.argmin(axis=1)
    owners = average_votes(votes, middles)
    for camera, ids in zip(cameras(), images, strict=True):
        found = draw_bolls(camera, lint, owners)
        named = np.concatenate([[0], same + 1])[found]
        assert (named == ids).mean() > 0.97
        both = (named > 0) & (ids > 0)
        assert (named[both] == ids[both]).mean() > 0.95
        assert both.sum() / ((named > 0) | (ids > 0)).sum() > 0.9


def test_either_half_of_the_views_counts_what_it_sees():
    """Every view twice, the first time with eyes for all but one boll."""
    gaussians, bolls = model()
    rng = np.random.default_rng(0)
    images = masks_of(gaussians, bolls, cameras())
    whole, blind = ([maps_of(camera, ids, rng) for camera, ids in zip(cameras(), images, strict=True)] for _ in "ab")
    for view, ids in zip(blind, images, strict=True):
        view.lint[ids == 1] = 0.02
    lint = LintInSpace.of(gaussians, gather_lint(whole, cameras(), gaussians, everything(gaussians)))
    sharp, dull = (
        [cast_votes(view, camera, lint) for view, camera in zip(maps, cameras(), strict=True)]
        for maps in (whole, blind)
    )
    n = len(separate_bolls(sharp, lint, UP).bolls.centres)
    assert n >= 4
    for first, counts in ((sharp, [n, n]), (dull, [n - 1, n])):
        halves = separate_all([view for pair in zip(first, sharp, strict=True) for view in pair], lint, UP)[1:]
        assert [len(half.bolls.centres) for half in halves] == counts


def test_lint_that_most_views_see_is_lint_in_all_of_them():
    """A third of the views takes a boll for no lint at all, and in another third the wall for lint."""
    gaussians, bolls = model()
    rng = np.random.default_rng(0)
    images = masks_of(gaussians, bolls, cameras())
    maps = []
    for number, (camera, ids) in enumerate(zip(cameras(), images, strict=True)):
        view = maps_of(camera, ids, rng)
        if number % 3 == 0:
            view.lint[ids == 1] = 0.1
        if number % 3 == 1:
            view.lint[ids == 0] = 0.7
        maps.append(view)
    lint = LintInSpace.of(gaussians, gather_lint(maps, cameras(), gaussians, everything(gaussians)))
    for camera, ids in zip(cameras(), images, strict=True):
        shown = lint.seen(camera)[0] > 0.5
        assert (shown & (ids > 0)).sum() / (shown | (ids > 0)).sum() > 0.85


def test_gaussians_that_are_not_allowed_are_no_lint():
    gaussians, bolls = model()
    images = masks_of(gaussians, bolls, cameras())
    rng = np.random.default_rng(0)
    maps = [maps_of(camera, ids, rng) for camera, ids in zip(cameras(), images, strict=True)]
    lint = LintInSpace.of(
        gaussians, gather_lint(maps, cameras(), gaussians, gaussians.means[:, 0] < CENTRES[:, 0].min() - 9)
    )
    assert not lint.shares.any()
    votes = [cast_votes(view, camera, lint) for view, camera in zip(maps, cameras(), strict=True)]
    assert not len(find_middles(votes).centres)


def test_what_one_view_alone_sees_is_no_boll():
    gaussians, bolls = model()
    rng = np.random.default_rng(0)
    images = masks_of(gaussians, bolls, cameras())
    for number, ids in enumerate(images):
        if number:
            ids[ids == 3] = 0
    maps = [maps_of(camera, ids, rng) for camera, ids in zip(cameras(), images, strict=True)]
    lint = LintInSpace.of(gaussians, gather_lint(maps, cameras(), gaussians, everything(gaussians)))
    middles = find_middles([cast_votes(v, c, lint) for v, c in zip(maps, cameras(), strict=True)])
    assert len(middles.centres) == len(CENTRES) - 1
    assert np.linalg.norm(middles.centres - CENTRES[2], axis=1).min() > RADIUS


def test_no_lint_is_no_boll():
    gaussians, _ = model()
    camera = cameras()[0]
    maps = maps_of(camera, np.zeros((camera.height, camera.width), int), np.random.default_rng(0))
    lint = LintInSpace.of(gaussians, gather_lint([maps, maps], [camera, camera], gaussians, everything(gaussians)))
    votes = cast_votes(maps, camera, lint)
    middles = find_middles([votes, votes])
    assert isinstance(middles, Middles) and not len(middles.centres)
    assert not draw_bolls(camera, lint, average_votes([votes, votes], middles)).any()


def test_specks_are_removed_and_pieces_behind_a_branch_kept():
    ids = np.zeros((40, 40), np.uint16)
    ids[5:20, 5:12] = ids[5:20, 14:20] = 3  # two halves of one boll beside a branch
    ids[30, 30:33] = 3
    cleaned = without_specks(ids)
    assert not cleaned[30].any()
    np.testing.assert_array_equal(cleaned[:25], ids[:25])


def test_a_boll_deep_in_another_is_found_by_the_votes_that_the_other_leaves_unexplained():
    """The middles lie 0.45 diameters apart; most votes are for the one, and how deep they lie is a guess."""
    rng = np.random.default_rng(3)
    centres = np.array([[0.0, 0, 0], [0.45, 0, 0]])
    votes = []
    for angle in 2 * np.pi * np.arange(12) / 12:
        eye = 12 * np.array([np.cos(angle), np.sin(angle), 0.3])
        own = np.repeat([0, 1], [150, 50])
        to = centres[own] + rng.normal(0, 0.1, (200, 3)) - eye
        rays = to / np.linalg.norm(to, axis=1, keepdims=True)
        surfaces = centres[own] - 0.4 * rays
        places = eye + to + rng.normal(0, 0.2, 200)[:, None] * rays
        votes.append(
            Votes(
                places.astype(np.float32),
                surfaces.astype(np.float32),
                rays.astype(np.float32),
                eye,
                np.ones(200, np.float32),
                np.full(200, 0.9, np.float32),
                np.full(200, 1 / 200, np.float32),
            )
        )
    first = find_middles(votes)
    assert len(first.centres) == 1
    middles = find_parts(votes, 0.25)
    order = np.argsort(middles.centres[:, 0])
    np.testing.assert_allclose(middles.centres[order], centres, atol=0.12)
    assert middles.support[order[0]] > middles.support[order[1]]


def votes_for(centres: np.ndarray, views: int = 12, pixels: int = 200) -> list[Votes]:
    """Of bolls that are one wide, seen from far away; noise is the same for a boll whatever other bolls there are."""
    seen = []
    for view, angle in enumerate(2 * np.pi * np.arange(views) / views):
        eye = 500 * np.array([np.cos(angle), np.sin(angle), 0.3])
        to = [
            centre + np.random.default_rng((view, boll)).normal(0, 0.1, (pixels, 3)) - eye
            for boll, centre in enumerate(centres)
        ]
        places = (np.concatenate(to) + eye).astype(np.float32)
        rays = (np.concatenate(to) / np.linalg.norm(np.concatenate(to), axis=1, keepdims=True)).astype(np.float32)
        ones = np.ones(len(places), np.float32)
        seen.append(Votes(places, places - 0.4 * rays, rays, eye, ones, 0.9 * ones, ones / pixels))
    return seen


def test_bolls_of_a_large_plant_are_told_apart_like_those_of_a_small_one():
    near = np.array([[0.0, 0, 0], [0.62, 0, 0], [0.1, 0.6, 0.2]])
    far = np.array([[90.0, 80, 70], [-60, 20, -50], [40, -70, 90]])
    alone, among = find_middles(votes_for(near)), find_middles(votes_for(np.concatenate([near, far])))
    assert len(alone.centres) == 3 and len(among.centres) == 6
    of_near = among.take(np.linalg.norm(among.centres, axis=1) < 2)
    np.testing.assert_allclose(of_near.centres, alone.centres, atol=1e-3)


@pytest.mark.parametrize("block", [20, 100])
def test_votes_are_smoothed_in_blocks_without_a_trace(block, monkeypatch):
    centres = np.random.default_rng(0).uniform(0, 5, (40, 3))
    usual = find_middles(votes_for(centres, 6, 60))
    assert len(usual.centres) > 20
    monkeypatch.setattr(hough_voting, "BLOCK", block)
    other = find_middles(votes_for(centres, 6, 60))
    for name in ("centres", "diameters", "support", "views"):
        assert (getattr(usual, name) == getattr(other, name)).all()


def test_rays_meet_where_they_were_sent_whatever_single_ones_do():
    rng = np.random.default_rng(0)
    target = np.array([0.3, -0.2, 0.5])
    eyes = rng.normal(size=(200, 3)) * 4
    rays = target + 0.02 * rng.normal(size=(200, 3)) - eyes
    rays[:40] = rng.normal(size=(40, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    weights = np.ones(200, np.float32)
    met = meet_rays(eyes, rays.astype(np.float32), weights, target + (0.05, 0.05, -0.05), size=0.4)
    assert np.linalg.norm(met - target) < 0.02
    seen_from_one_place = meet_rays(np.zeros((5, 3)), rays[100:105] * 0 + (0, 0, 1), weights[:5], target, 0.4)
    assert seen_from_one_place[2] == pytest.approx(target[2], abs=1e-6), "along rays that do not cross nothing moves"
