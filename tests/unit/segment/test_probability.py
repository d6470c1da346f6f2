# SPDX-License-Identifier: Apache-2.0
"""Probabilities fitted to masks: sparse products against the rasterizer, wrong beginnings and masks without sense."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import torch.nn.functional as F  # noqa: N812
from scenes.boll_scene import cameras, masks_of, model
from scenes.splat_scenes import arrays_of, native_view, round_gaussians

from cotton3dg._native import for_tests
from cotton3dg.core.scene import SH_CONSTANT, Camera, Gaussians
from cotton3dg.gaussians.rasterizer import near_plane, render_values
from cotton3dg.segment.probability import (
    TrainingView,
    cross_entropy_gradient,
    mean_binary_ious,
    sample_pixels,
    sample_view,
    train_probabilities,
)
from cotton3dg.segment.probability_pictures import draw_lint, draw_training

SIZE = (60, 50)


@pytest.fixture(scope="module")
def scene():
    gaussians, bolls = model()
    views = [view.resized(*SIZE) for view in cameras()[::3]]
    return gaussians, bolls, views, [ids > 0 for ids in masks_of(gaussians, bolls, views)]


def view_of_renders(gaussians: Gaussians, camera: Camera, inside: np.ndarray) -> TrainingView:
    """The same training by rendering and rasterizing backwards, as the paper does it.

    The image is linear in the values, so the gradient by them is that by a colour, whatever this is.
    """
    white = replace(gaussians, sh=np.full((len(gaussians), 1, 3), 0.5 / SH_CONSTANT, np.float32))
    view = native_view(camera, near_plane(gaussians, camera))

    def render(probabilities):
        return render_values(gaussians, camera, probabilities[:, None]).image.ravel()

    def gradient(v_map):
        v_image = np.zeros((*inside.shape, 3), np.float32)
        v_image[..., 0] = v_map.reshape(inside.shape)
        found = for_tests.image_gradient(arrays_of(white), view, 0, np.zeros(3, np.float32), v_image, 0)[1]
        return found["v_colours"][:, 0]

    return TrainingView(render, gradient, inside.ravel().astype(np.float32))


def fitted(views, start, steps, **options):
    for _, probabilities in train_probabilities(views, start, steps, **options):
        assert probabilities.min() >= 0 and probabilities.max() <= 1
    return probabilities


def test_sparse_products_train_as_the_rasterizer_does(scene):
    gaussians, _, cameras, masks = scene
    start = np.full(len(gaussians), 0.5, np.float32)
    by_rays = fitted([sample_view(gaussians, *pair, 1, 0) for pair in zip(cameras, masks, strict=True)], start, 60)
    renders = [view_of_renders(gaussians, *pair) for pair in zip(cameras, masks, strict=True)]
    by_renders = fitted(renders, start, 60)
    assert np.abs(by_rays - 0.5).max() > 0.02
    # Adam makes whole steps out of the faintest gradients, whose sign may then hang on rounding.
    assert np.abs(by_rays - by_renders).max() < 5e-4
    assert np.abs(by_rays - by_renders).mean() < 1e-6


def test_cross_entropy_is_finite_at_the_ends():
    values = np.float32([0, 1, -0.5, 1.5, 1e-30, 0.3, 0.8])
    for target in (0, 1):
        gradient = cross_entropy_gradient(values, np.full(7, target, np.float32))
        assert np.isfinite(gradient).all() and np.abs(gradient).max() <= 101 / 7
        # Away from the ends that of autograd, at the ends still towards the target.
        probabilities = torch.tensor(values[5:], requires_grad=True)
        F.binary_cross_entropy(probabilities, torch.full((2,), float(target)), reduction="sum").backward()
        np.testing.assert_allclose(gradient[5:], probabilities.grad / 7, rtol=1e-6)
        assert (np.sign(gradient) == (1 - 2 * target)).all()


@pytest.mark.parametrize("spacing_px", [1, 2])
def test_flipped_labels_recover(scene, spacing_px):
    gaussians, bolls, cameras, masks = scene
    views = [sample_view(gaussians, *pair, spacing_px, 0) for pair in zip(cameras, masks, strict=True)]
    flipped = np.where(bolls > 0, 0, 1).astype(np.float32)
    probabilities = fitted(views, flipped, 600, learning_rate=0.01)
    seen = sum(view.gradient(np.ones_like(view.targets)) for view in views) > 0.5 / spacing_px**2
    assert seen[bolls > 0].sum() > 100 and seen[bolls == 0].sum() > 50
    assert np.median(probabilities[seen & (bolls > 0)]) > 0.8
    assert ((probabilities > 0.5) == (bolls > 0))[seen].mean() > 0.9


@pytest.mark.parametrize("kind", ["empty", "full", "contradictory"])
def test_masks_without_sense_give_probabilities_all_the_same(scene, kind):
    gaussians, bolls, cameras, masks = scene
    wrong = {
        "empty": [np.zeros_like(inside) for inside in masks],
        "full": [np.ones_like(inside) for inside in masks],
        "contradictory": [inside ^ (k % 2 == 1) for k, inside in enumerate(masks)],
    }[kind]
    views = [sample_view(gaussians, *pair, 1, 0) for pair in zip(cameras, wrong, strict=True)]
    probabilities = fitted(views, np.full(len(gaussians), 0.5, np.float32), 300, learning_rate=0.01)
    assert np.isfinite(probabilities).all()
    on_bolls = np.median(probabilities[bolls > 0])
    assert {"empty": on_bolls < 0.1, "full": on_bolls > 0.9, "contradictory": 0.1 < on_bolls < 0.9}[kind]


def test_what_no_view_shows_stays_as_it_was(scene):
    gaussians, _, cameras, masks = scene
    moved = Gaussians(**vars(gaussians) | {"means": gaussians.means + np.float32([0, 0, 100])})
    views = [sample_view(moved, *pair, 1, 0) for pair in zip(cameras, masks, strict=True)]
    assert (fitted(views, np.full(len(gaussians), 0.3, np.float32), 5) == np.float32(0.3)).all()


def test_one_ray_stands_for_each_square():
    assert np.array_equal(np.unique(sample_pixels(7, 5, 1, 0), axis=0), np.argwhere(np.ones((7, 5))))
    pixels = sample_pixels(32, 20, 4, 3)
    assert np.array_equal(np.unique(pixels // 4, axis=0), np.argwhere(np.ones((8, 5))))
    assert len(np.unique(pixels % 4, axis=0)) > 8
    assert not np.array_equal(pixels, sample_pixels(32, 20, 4, 4))
    assert (sample_pixels(31, 19, 4, 0) < (31, 19)).all()


def test_mean_ious():
    inside = np.zeros((2, 4), bool)
    inside[0] = True
    image = np.zeros((2, 4, 2), np.float32)
    image[0, :, 0] = [0.72, 0.78, 0.85, 0.95]
    image[:, :2, 1] = 1
    nothing = np.zeros((2, 4), bool)
    ious = mean_binary_ious([image, image * 0], [inside, nothing])
    np.testing.assert_allclose(ious, [[1, 0.75, 0.5, 0.25], [1 / 3] * 4])
    assert np.isnan(mean_binary_ious([image * 0], [nothing])).all()


def test_the_picture_of_a_training_has_a_map_for_each_step():
    """One Gaussian before the camera: dark at p = 0, the brightest yellow of the map at p = 1."""
    gaussians = round_gaussians(np.array([[0, 0, 2.0]]), 0.4, logit=7.0)
    camera = Camera("a.jpg", 64, 48, 60.0, 60.0, 32.0, 24.0, np.eye(4)[:3])
    steps = {n: np.full(1, p, np.float32) for n, p in ((0, 0.0), (500, 0.5), (1000, 1.0), (2000, 1.0), (3000, 1.0))}
    picture = draw_training(gaussians, camera, steps)
    assert picture.shape == (720, 1920, 3)  # two rows of four, the last three blank
    middles = picture[180::360, 240::480].reshape(-1, 3).astype(int)
    assert middles[:3].sum(axis=1).tolist() == sorted(middles[:3].sum(axis=1).tolist())
    assert middles[2].tolist() == pytest.approx([253, 231, 37], abs=12)
    assert (middles[5:] == 255).all()
    lint = draw_lint(gaussians, camera)
    assert lint.shape == (48, 64, 3) and lint[24, 32].max() > 100 and lint[0, 0].max() < 5
