# SPDX-License-Identifier: Apache-2.0
"""Affinity features: their loss against a literal one, what training makes of them, and how sets grow."""

import cv2
import numpy as np
import pytest
import torch
from scenes.boll_scene import CENTRES, RADIUS, cameras, masks_of, model

from cotton3dg.gaussians.rasterizer import accumulate_weights, render_values
from cotton3dg.segment.affinity import (
    RAYS_PER_VIEW,
    affinity_loss,
    find_heaviest_weights,
    neighbour_means,
    sample_rays,
    train_features,
)
from cotton3dg.segment.lift import ViewWeights
from cotton3dg.segment.prompts import PromptView, grow, lift_prompts


@pytest.fixture(scope="module")
def scene():
    gaussians, bolls = model()
    views = cameras()[::3]
    return gaussians, bolls, views, masks_of(gaussians, bolls, views)


@pytest.fixture(scope="module")
def trained(scene):
    gaussians, _, views, id_images = scene
    smoothing = neighbour_means(gaussians.means)
    rays = [sample_rays(gaussians, *pair, smoothing, k) for k, pair in enumerate(zip(views, id_images, strict=True))]
    features, losses = train_features(rays, len(gaussians), 16, 250)
    return smoothing @ features, features, losses


def literal_loss(rendered: torch.Tensor, ids: torch.Tensor) -> torch.Tensor:
    """Pixel by pixel and pair by pair."""
    unit = rendered / rendered.norm(dim=1, keepdim=True)
    masks = []
    for name in sorted(set(ids[ids > 0].tolist())):
        query = rendered[ids == name].detach().mean(0)
        p = torch.sigmoid(10 * (unit @ query / query.norm() - 0.5))
        masks.append(-p[ids == name].log().mean() - (1 - p[ids != name]).log().mean())
    alike, apart = [], []
    for i in range(len(ids)):
        for j in range(len(ids)):
            if ids[i] == 0:
                continue
            (alike if ids[i] == ids[j] else apart).append(unit[i] @ unit[j])
    pairs = (1 - torch.stack(alike)).mean() + torch.stack(apart).clamp(min=0).mean()
    return torch.stack(masks).mean() + pairs + ((1 - rendered.norm(dim=1)) ** 2).mean()


def test_the_loss_and_its_gradient_are_the_stated_ones():
    rng = np.random.default_rng(0)
    ids = torch.tensor([0, 0, 0, 1, 1, 1, 4, 4, 2])
    one, other = (torch.tensor(rng.normal(size=(9, 5)), requires_grad=True) for _ in range(2))
    other.data[:] = one.data
    losses = affinity_loss(one.float(), ids), literal_loss(other, ids)
    for loss in losses:
        loss.backward()
    assert losses[0].item() == pytest.approx(losses[1].item(), rel=1e-5)
    torch.testing.assert_close(one.grad, other.grad, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("ids", [[0, 0, 0], [3, 3, 3], [1, 2, 0]])
def test_no_loss_is_undefined(ids):
    """All background, all one mask, features without direction."""
    for rendered in (torch.zeros(3, 4), torch.ones(3, 4)):
        rendered.requires_grad_()
        loss = affinity_loss(rendered, torch.tensor(ids))
        loss.backward()
        assert torch.isfinite(loss) and torch.isfinite(rendered.grad).all()


def test_rays_are_half_in_masks(scene):
    gaussians, _, views, id_images = scene
    ids = id_images[0].copy()
    ids[100:106, 5:11] = 9
    rays = sample_rays(gaussians, views[0], ids, neighbour_means(gaussians.means), 0)
    assert len(rays.ids) <= RAYS_PER_VIEW
    hits = np.bincount(rays.ids)
    assert 0.4 < (rays.ids > 0).mean() <= 0.55
    # A mask of 36 px gets all of its rays, one a pixel; the others share what is left.
    assert hits[9] == 36 and (hits[1:6][hits[1:6] > 0] > 100).all()
    near = cv2.dilate((ids > 0).astype(np.uint8), np.ones((21, 21), np.uint8)) > 0
    assert near.mean() < 0.5 and (rays.ids == 0).sum() >= RAYS_PER_VIEW // 4


def test_the_heaviest_weights_of_a_ray(scene):
    gaussians, _, views, _ = scene
    pixels = np.stack(np.meshgrid(np.arange(100, 140), np.arange(80, 120)), axis=-1).reshape(-1, 2)
    weights = find_heaviest_weights(gaussians, views[0], pixels)
    assert np.diff(weights.indptr).max() == 16
    values = np.random.default_rng(0).uniform(0, 1, (len(gaussians), 1)).astype(np.float32)
    image = render_values(gaussians, views[0], values).image[pixels[:, 1], pixels[:, 0]]
    few = np.diff(weights.indptr) < 16
    assert few.sum() > 100
    np.testing.assert_allclose((weights @ values)[few], image[few], atol=1e-6)
    assert (weights @ values <= image + 1e-6).all()


def test_features_agree_within_bolls_only(scene, trained):
    _, bolls, _, _ = scene
    smooth, raw, losses = trained
    assert np.isfinite(smooth).all() and np.mean(losses[-20:]) < 0.7 * np.mean(losses[:20])
    lengths = np.linalg.norm(raw, axis=1)
    assert np.allclose(lengths[lengths > 0], 1, atol=1e-5) and (lengths == 0).any() | (lengths > 0).all()
    unit = smooth / np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-6)
    means = np.array([unit[bolls == k].mean(axis=0) for k in range(1, 6)])
    means /= np.linalg.norm(means, axis=1, keepdims=True)
    cosines = means @ means.T
    assert (cosines - np.eye(5)).max() < 0.6
    assert np.median(np.sum(unit[bolls > 0] * means[bolls[bolls > 0] - 1], axis=1)) > 0.75


@pytest.fixture(scope="module")
def prompts(scene):
    gaussians, _, views, id_images = scene
    found = []
    for view, ids in zip(views, id_images, strict=True):
        sums = accumulate_weights(gaussians, view, ids)
        found.append(PromptView(view, ids, ViewWeights(view.name, sums.total, sums.rows, sums.ids, sums.weights)))
    return found


def test_masks_prompt_their_bolls(scene, trained, prompts):
    gaussians, bolls, views, id_images = scene
    allowed = np.ones(len(gaussians), bool)
    lifted, dropped = lift_prompts(gaussians, trained[0], prompts[::-1], allowed, "sha")
    n_masks = sum(len(np.unique(ids)) - 1 for ids in id_images)
    assert lifted.views == tuple(view.name for view in views) and lifted.gaussians_sha256 == "sha"
    assert len(lifted.selections) + sum(dropped.values()) == n_masks and len(lifted.selections) > 0.7 * n_masks
    for selection in lifted.selections:
        assert (bolls[selection.indices] == selection.mask_id).mean() > 0.9
        assert np.isin(selection.indices, lifted.candidates).all() and (selection.weights > 0).all()
    nothing, dropped = lift_prompts(gaussians, np.zeros_like(trained[0]), prompts, allowed, "")
    assert not nothing.selections and nothing.seen.shape == (4, 0) and dropped["too_small"] == n_masks


def test_gaussians_are_judged_among_gaussians(scene, prompts):
    """Pixels mix features and agree far better than the Gaussians behind them, most of which belong to the set."""
    gaussians, bolls, _, _ = scene
    noise = np.random.default_rng(0).normal(size=(len(gaussians), 16))
    features = (np.eye(6, 16)[bolls] + 0.15 * noise).astype(np.float32)
    lifted, _ = lift_prompts(gaussians, features, prompts, np.ones(len(gaussians), bool), "")
    for selection in lifted.selections:
        weights = prompts[lifted.views.index(selection.view)].weights
        inside = weights.rows[
            (weights.ids == selection.mask_id) & (weights.weights > 0.9 * weights.total[weights.rows])
        ]
        assert np.isin(inside[bolls[inside] == selection.mask_id], selection.indices).mean() > 0.75


def test_views_without_masks_train_nothing(scene):
    gaussians, _, views, id_images = scene
    smoothing = neighbour_means(gaussians.means)
    rays = [sample_rays(gaussians, views[0], id_images[0] * 0, smoothing, 0)]
    features, losses = train_features(rays, len(gaussians), 8, 10)
    assert not features.any() and features.shape == (len(gaussians), 8) and losses == []


def test_sets_grow_by_short_steps_within_a_ball():
    rng = np.random.default_rng(1)
    sphere = rng.normal(size=(2, 400, 3))
    sphere *= RADIUS / np.linalg.norm(sphere, axis=2, keepdims=True)
    # Two bolls alike, the second a gap away.
    points = (sphere + np.array([CENTRES[0], CENTRES[0] + [3 * RADIUS, 0, 0]])[:, None]).reshape(-1, 3)
    facing = np.flatnonzero((points[:, 1] < -0.2 * RADIUS) & (np.arange(800) < 400))
    rows = grow(points, facing, np.ones(800, bool))
    assert np.array_equal(rows, np.sort(rows)) and rows.max() < 400
    assert len(rows) > 270 and np.isin(facing, rows).all()
    assert np.array_equal(grow(points, facing, np.isin(np.arange(800), facing)), facing)
