# SPDX-License-Identifier: Apache-2.0
"""Hard cases 9 to 16: blending, forward and backward."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import splatting
import torch
from scenes.differentiation import image_gradient, loss_and_gradients
from scenes.splat_scenes import NEAR, all_finite, arrays_of, camera_at, double, native_view, scene, target_of

from cotton3dg import _native
from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians import rasterizer

NAMES = ("v_means", "v_quats", "v_log_scales", "v_opacity_logits", "v_sh")


def stack(count: int, logit: float) -> Gaussians:
    """Gaussians behind each other, each over the whole image."""
    gaussians = scene(count, seed=0)
    gaussians.means[:] = 0
    gaussians.means[:, 2] = np.linspace(-0.5, 0.5, count)
    gaussians.log_scales[:] = 5
    gaussians.opacity_logits[:] = logit
    return gaussians


def assert_gradients_match_autograd(gaussians: Gaussians, camera: Camera, background: np.ndarray) -> None:
    v_image = np.random.default_rng(1).normal(size=(camera.height, camera.width, 3))
    parameters = [torch.from_numpy(a).requires_grad_() for a in double(gaussians)]
    image = splatting.render(*parameters, camera, 3, torch.from_numpy(background), NEAR)
    (image * torch.from_numpy(v_image)).sum().backward()
    gradients = image_gradient(double(gaussians), native_view(camera), 3, background, v_image, 2)[1]
    largest = max(float(parameter.grad.abs().max()) for parameter in parameters)
    for key, parameter in zip(NAMES, parameters, strict=True):
        expected = parameter.grad.numpy()
        assert np.linalg.norm(gradients[key] - expected) <= 1e-9 * max(np.linalg.norm(expected), 1e-6 * largest), key


@pytest.mark.parametrize("slot", ["means", "quats", "log_scales", "opacity_logits", "sh"])
def test_case_09_nan_is_not_hidden_by_the_cap(slot: str) -> None:
    """min(0.99, NaN) is 0.99 on some hardware: a NaN must cost its Gaussian, and nothing else."""
    gaussians, camera = scene(20, seed=0), camera_at(40, 30)
    clean = rasterizer.render(gaussians[1:], camera, near_su=NEAR)
    for k in range(getattr(gaussians, slot)[0].size):
        poisoned = Gaussians(*(a.copy() for a in arrays_of(gaussians)))
        getattr(poisoned, slot).reshape(20, -1)[0, k] = np.nan
        rendered = rasterizer.render(poisoned, camera, near_su=NEAR)
        assert rendered.culled["non_finite"] == 1
        assert np.array_equal(rendered.image, clean.image)
        gradients = loss_and_gradients(poisoned, camera, target_of(camera), near_su=NEAR)
        assert gradients.finite
        assert all_finite(*(getattr(gradients, name) for name in NAMES))


@pytest.mark.parametrize("logit", [3.0, 4.59, 4.6, 5.5, 8.0])
def test_case_10_forward_and_backward_have_one_alpha_cap(logit: float) -> None:
    """0.99 is the opacity of logit 4.595: opaque stacks on either side of it against autograd."""
    gaussians = stack(5, logit)
    gaussians.log_scales[:] = np.log([0.3, 0.35, 0.5])
    assert_gradients_match_autograd(gaussians, camera_at(20, 17), np.array([0.3, 0.6, 0.9]))


def test_case_10_the_cap_is_that_of_the_reference() -> None:
    rendered = rasterizer.render(stack(1, 30.0), camera_at(4, 4), near_su=NEAR)
    np.testing.assert_allclose(rendered.transmittance, 1 - splatting.ALPHA_CAP, rtol=1e-5)


def test_case_11_a_saturated_alpha_has_no_gradient() -> None:
    gaussians, camera = stack(1, 30.0), camera_at(4, 4)
    gradients = loss_and_gradients(gaussians, camera, target_of(camera), sh_degree=0, near_su=NEAR)
    assert not gradients.v_opacity_logits.any()
    assert not gradients.v_means.any()
    assert not gradients.v_log_scales.any()
    assert gradients.v_sh.any()


@pytest.mark.parametrize("logit", [1.0, 3.0, 4.59])
def test_case_12_sixteen_stacked_gaussians_keep_float_near_double(logit: float) -> None:
    """Dividing by 1 - alpha sixteen times must not drift."""
    gaussians, camera = stack(16, logit), camera_at(12, 12)
    v_image = np.random.default_rng(2).normal(size=(12, 12, 3))
    view, background = native_view(camera), np.array([0.2, 0.4, 0.6])
    exact = image_gradient(double(gaussians), view, 3, background, v_image, 1)[1]
    single = image_gradient(
        arrays_of(gaussians), view, 3, background.astype(np.float32), v_image.astype(np.float32), 1
    )[1]
    largest = max(np.abs(exact[key]).max() for key in NAMES)
    for key in NAMES:
        assert np.linalg.norm(single[key] - exact[key]) <= 1e-4 * max(np.linalg.norm(exact[key]), 1e-3 * largest), key


def test_case_12_a_stack_of_opaque_gaussians_ends_a_pixel() -> None:
    gaussians, camera = stack(16, 30.0), camera_at(8, 8)
    rendered = rasterizer.render(gaussians, camera, near_su=NEAR)
    np.testing.assert_allclose(rendered.transmittance, 0.01**2, rtol=1e-3)
    gradients = loss_and_gradients(gaussians, camera, target_of(camera), near_su=NEAR)
    reached = np.abs(gradients.v_sh).sum((1, 2)) > 0
    assert reached[:2].all()
    assert not reached[3:].any()


@pytest.mark.parametrize("seed", range(8))
def test_case_13_backward_visits_exactly_what_forward_blended(seed: int) -> None:
    """Where forward gave a Gaussian weight, and nowhere else, backward gives its colour the same weight."""
    gaussians, camera = scene(400, seed), camera_at(50, 40)
    gaussians.opacity_logits[:] += 3  # many pixels stop early
    gaussians.sh[:] = 0
    total = rasterizer.accumulate_weights(gaussians, camera, np.zeros((40, 50), np.uint16), near_su=NEAR).total
    view, ones = native_view(camera), np.ones((40, 50, 3), np.float32)
    gradients = image_gradient(arrays_of(gaussians), view, 0, np.zeros(3, np.float32), ones, 2)[1]
    v_colour = gradients["v_colours"][:, 0]
    assert 0 < (total > 0).sum() < len(total)
    assert np.array_equal(v_colour > 0, total > 0)
    np.testing.assert_allclose(v_colour, total, rtol=1e-5)
    weight = loss_and_gradients(gaussians, camera, target_of(camera), near_su=NEAR).weight
    np.testing.assert_allclose(weight, total, rtol=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_case_14_the_background_counts_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gaussians = scene(15, seed)
    gaussians.opacity_logits[:] -= 2  # much background shows through
    assert_gradients_match_autograd(gaussians, camera_at(24, 19), rng.uniform(-2, 3, 3))


def test_case_15_of_two_equal_depths_the_first_row_is_in_front() -> None:
    camera, gaussians = camera_at(9, 9), stack(2, 30.0)
    gaussians.means[:] = 0
    gaussians.sh[:] = 0
    gaussians.sh[0, 0], gaussians.sh[1, 0] = 1.0, -1.0
    assert rasterizer.render(gaussians, camera, near_su=NEAR).image.mean() > 0.7
    assert rasterizer.render(gaussians[::-1], camera, near_su=NEAR).image.mean() < 0.3


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_case_15_many_equal_depths_are_drawn_in_row_order(threads: int) -> None:
    """All in one plane, and in few planes: against the reference, which sorts by (depth, row)."""
    camera, rng = camera_at(20, 16), np.random.default_rng(0)
    for planes in (1, 3):
        gaussians = scene(150, seed=4)
        gaussians.means[:, 2] = rng.integers(0, planes, 150) * np.float32(0.25)
        gaussians.opacity_logits[:] += 2
        parameters = [torch.from_numpy(a) for a in double(gaussians)]
        expected = splatting.render(*parameters, camera, 3, torch.zeros(3, dtype=torch.float64), NEAR).numpy()
        exact = _native.render(double(gaussians), native_view(camera), 3, np.zeros(3), threads)[0]
        assert np.abs(exact - expected).max() < 1e-10


def test_case_15_poisoned_depths_never_reach_the_sort() -> None:
    camera, gaussians = camera_at(20, 16), scene(100, seed=4)
    clean = rasterizer.render(gaussians[::2], camera, near_su=NEAR)
    gaussians.means[1::2, 2] = np.resize(np.float32([np.nan, np.inf, -np.inf, np.nan]), 50)
    rendered = rasterizer.render(gaussians, camera, near_su=NEAR)
    assert rendered.culled["non_finite"] == 50
    assert np.array_equal(rendered.image, clean.image)


@pytest.mark.parametrize("growth", [-2.0, 0.0, 1.5])
def test_case_16_no_tile_or_block_edge_shows(growth: float, record_property) -> None:
    """The same view with its pixels at other places in the tiles: every shift within a tile, in double.

    Changing the size of tiles would do nothing else to a pixel than to give it other neighbours in its tile. Opaque
    Gaussians reach farther than 3 σ, where alpha is still 0.01: a cut there would show.
    """
    size, worst = 40, 0.0
    camera, gaussians = camera_at(size, size), scene(25, seed=1)
    gaussians.log_scales[:] += growth
    gaussians.opacity_logits[:] += 3
    reference = _native.render(double(gaussians), native_view(camera), 3, np.zeros(3), 2)[0]
    for shift in range(1, 17):
        for dx, dy in ((shift, 0), (0, shift), (shift, 17 - shift)):
            moved = replace(camera, cx=camera.cx + dx, cy=camera.cy + dy, width=size + dx, height=size + dy)
            image = _native.render(double(gaussians), native_view(moved), 3, np.zeros(3), 2)[0][dy:, dx:]
            worst = max(worst, float(np.abs(image - reference).max()))
    record_property("another place in the tiles, double (<= 1e-9)", worst)
    assert worst < 1e-9


def test_case_16_float_has_no_edges_either(record_property) -> None:
    """Single precision against the reference without tiles; what flips at the alpha cut is rare and without bias."""
    camera, flipped, bias = camera_at(97, 83), 0.0, 0.0
    for seed in range(4):
        gaussians = scene(60, seed)
        gaussians.log_scales[:] -= 1.5
        gaussians.opacity_logits[:] += 3
        parameters = [torch.from_numpy(a) for a in double(gaussians)]
        expected = splatting.render(*parameters, camera, 3, torch.zeros(3, dtype=torch.float64), NEAR).numpy()
        difference = rasterizer.render(gaussians, camera, near_su=NEAR).image - expected
        flipped = max(flipped, float((np.abs(difference).max(-1) > 1e-4).mean()))
        bias = max(bias, abs(float(difference.mean())))
    record_property("share of pixels that flip at a discontinuity (<= 1e-3)", flipped)
    assert flipped <= 1e-3
    assert bias < 1e-6
