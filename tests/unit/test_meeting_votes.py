"""Votes of all views for the middles of bolls meet in space."""

import numpy as np
import pytest
from scenes.boll_scene import CENTRES, RADIUS, cameras, masks_of, model

from cotton3dg.masks.bolls import Maps
from cotton3dg.masks.meeting_votes import Middles, find_middles, painted, votes_in_space


def maps_of(camera, ids: np.ndarray, rng: np.random.Generator, noise: float = 0.0) -> Maps:
    """What the network should say of an image of the scene, at the size of the image; `noise` in diameters."""
    pixels, depths = camera.project(CENTRES)
    size = np.concatenate([[1.0], 2 * RADIUS * camera.fx / depths])
    table = np.concatenate([[[0.0, 0.0]], pixels])
    lint = np.where(ids > 0, 0.9, 0.05)
    probabilities = np.zeros((5, *ids.shape), np.float32)
    probabilities[1], probabilities[0] = lint, 1 - lint
    votes = table[ids] + noise * size[ids][..., None] * rng.normal(size=(*ids.shape, 2))
    return Maps(
        probabilities,
        votes.transpose(2, 0, 1).astype(np.float32),
        np.zeros(ids.shape, np.float32),
        size[ids].astype(np.float32),
        1.0,
        ids.shape,
    )


@pytest.mark.parametrize("noise", [0, 0.15])
def test_votes_meet_in_the_middles_of_the_bolls(noise):
    gaussians, bolls = model()
    rng = np.random.default_rng(0)
    images = masks_of(gaussians, bolls, cameras())
    maps = [maps_of(camera, ids, rng, noise) for camera, ids in zip(cameras(), images, strict=True)]
    votes = [votes_in_space(view, camera, gaussians) for view, camera in zip(maps, cameras(), strict=True)]
    middles = find_middles(votes)
    assert len(middles.centres) == len(CENTRES)
    distances = np.linalg.norm(middles.centres[:, None] - CENTRES, axis=2)
    assert (distances.min(axis=1) < 0.25 * RADIUS).all()
    np.testing.assert_allclose(middles.diameters, 2 * RADIUS, rtol=0.15)
    assert (middles.views >= 6).all()
    same = distances.argmin(axis=1)
    for view, own, ids in zip(maps, votes, images, strict=True):
        found, scores = painted(view, own, middles)
        assert set(scores) == set(np.unique(found[found > 0]).tolist())
        named = np.concatenate([[0], same + 1])[found]
        both = (named > 0) & (ids > 0)
        assert (named[both] == ids[both]).mean() > 0.93
        if not noise:
            assert both.sum() / ((named > 0) | (ids > 0)).sum() > 0.9


def test_what_one_view_alone_sees_is_no_boll():
    gaussians, bolls = model()
    rng = np.random.default_rng(0)
    images = masks_of(gaussians, bolls, cameras())
    for number, ids in enumerate(images):
        if number:
            ids[ids == 3] = 0
    maps = [maps_of(camera, ids, rng) for camera, ids in zip(cameras(), images, strict=True)]
    middles = find_middles([votes_in_space(v, c, gaussians) for v, c in zip(maps, cameras(), strict=True)])
    assert len(middles.centres) == len(CENTRES) - 1
    assert np.linalg.norm(middles.centres - CENTRES[2], axis=1).min() > RADIUS


def test_no_lint_is_no_boll():
    gaussians, _ = model()
    camera = cameras()[0]
    maps = maps_of(camera, np.zeros((camera.height, camera.width), int), np.random.default_rng(0))
    votes = votes_in_space(maps, camera, gaussians)
    middles = find_middles([votes, votes])
    assert isinstance(middles, Middles) and not len(middles.centres)
    ids, scores = painted(maps, votes, middles)
    assert not ids.any() and scores == {}
