# SPDX-License-Identifier: Apache-2.0
"""Hard cases 2 to 8, 17, 20 and 21: from parameters to pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import splatting
import torch
from scenes.differentiation import image_gradient, loss_and_gradients
from scenes.splat_scenes import (
    NEAR,
    all_finite,
    arrays_of,
    assert_step_stays_finite,
    camera_at,
    double,
    native_view,
    scene,
    step,
    target_of,
)

from cotton3dg import _native
from cotton3dg.core.scene import Gaussians
from cotton3dg.gaussians import rasterizer

SIZES = (1, 3, 15, 16, 17, 64, 257)


def lone(log_scale: float = -2.0, logit: float = 4.0) -> Gaussians:
    """One Gaussian at the origin."""
    gaussians = scene(1, seed=0)
    gaussians.means[:] = 0
    gaussians.log_scales[:] = log_scale
    gaussians.opacity_logits[:] = logit
    return gaussians


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
def test_case_02_infinite_scale_is_culled_and_counted(value: float) -> None:
    gaussians, camera = scene(20, seed=0), camera_at(40, 30)
    clean = rasterizer.render(gaussians[1:], camera, near_su=NEAR)
    gaussians.log_scales[0, 1] = value
    rendered = rasterizer.render(gaussians, camera, near_su=NEAR)
    assert rendered.culled["non_finite"] == 1
    assert np.array_equal(rendered.image, clean.image)
    report = assert_step_stays_finite(gaussians, camera)
    assert report.finite
    assert report.culled["non_finite"] == 1


def test_case_03_any_log_scale_is_drawn_and_only_free_ones_have_a_gradient() -> None:
    camera = camera_at(31, 31)
    for log_scale in np.linspace(-90, 90, 61):
        gaussians = lone(log_scale)
        rendered = rasterizer.render(gaussians, camera, near_su=NEAR)
        assert rendered.n_visible == 1
        assert rendered.transmittance.min() < 0.5, log_scale
        gradients = loss_and_gradients(gaussians, camera, target_of(camera), near_su=NEAR)
        assert gradients.finite
        if abs(log_scale) >= 30:
            assert not gradients.v_log_scales.any(), log_scale
        assert_step_stays_finite(gaussians, camera)


def test_case_03_the_clamp_is_continuous() -> None:
    camera = camera_at(31, 31)
    images = [
        rasterizer.render(lone(log_scale), camera, near_su=NEAR).image for log_scale in (29.99, 30.0, 30.01, 88.0)
    ]
    for image in images[1:]:
        np.testing.assert_allclose(image, images[0], atol=1e-5)


def test_case_04_needles_match_double(record_property) -> None:
    """σ up to 1e4 px at any angle: the determinant of the covariance must not cancel."""
    camera, flipped, bias = camera_at(64, 64), 0.0, 0.0
    for seed, length in enumerate((1.0, 10.0, 100.0, 400.0)):
        gaussians = scene(8, seed)
        gaussians.log_scales[:] = np.log([length, 1e-5, 1e-5])
        single = _native.render(arrays_of(gaussians), native_view(camera), 0, np.zeros(3, np.float32), 1)[0]
        exact = _native.render(double(gaussians), native_view(camera), 0, np.zeros(3), 1)[0]
        flipped = max(flipped, float((np.abs(single - exact).max(-1) > 1e-3).mean()))
        bias = max(bias, abs(float((single - exact).mean())))
    record_property("needles, share of pixels off by more than 1e-3 (<= 1e-3)", flipped)
    assert flipped <= 1e-3
    assert bias < 1e-4


def scaled(gaussians: Gaussians, factor: float) -> Gaussians:
    means, log_scales = gaussians.means * np.float32(factor), gaussians.log_scales + np.float32(np.log(factor))
    return replace(gaussians, means=means, log_scales=log_scales)


@pytest.mark.parametrize("factor", [1e-3, 2.0**-10, 2.0**10, 1e3])
def test_case_05_the_near_plane_scales_with_the_scene(factor: float) -> None:
    camera, gaussians = camera_at(60, 40), scene(200, seed=5)
    pose = camera.cam_from_scene.copy()
    pose[:, 3] *= factor
    reference = rasterizer.render(gaussians, camera)
    rendered = rasterizer.render(scaled(gaussians, factor), replace(camera, cam_from_scene=pose))
    assert rendered.culled == reference.culled
    differs = np.abs(rendered.image - reference.image).max(-1) > 1e-4
    assert differs.mean() <= 1e-3
    np.testing.assert_allclose(rendered.depth, reference.depth * factor, rtol=2e-3)


def test_case_06_a_gaussian_at_the_camera_centre_is_culled_without_gradient() -> None:
    camera, gaussians = camera_at(20, 20), scene(3, seed=0)
    gaussians.means[1] = camera.centre
    for near_su in (NEAR, 1e-30):
        assert rasterizer.render(gaussians, camera, near_su=near_su).culled["behind"] == 1
        gradients = loss_and_gradients(gaussians, camera, target_of(camera), near_su=near_su)
        assert gradients.finite
        assert not gradients.v_means[1].any()
        assert not gradients.v_sh[1].any()


def test_case_07_the_gradient_is_that_of_the_frozen_jacobian() -> None:
    """Means far beyond the frustum, footprints that still reach in: against autograd of the clamped forward."""
    camera, gaussians = camera_at(40, 30), scene(8, seed=3)
    gaussians.means[:, 0] = np.linspace(2.5, 6, 8) * np.where(np.arange(8) % 2, 1, -1)
    gaussians.log_scales[:] = np.log([1.2, 0.9, 1.5])
    v_image = np.random.default_rng(0).normal(size=(30, 40, 3))
    parameters = [torch.from_numpy(a).requires_grad_() for a in double(gaussians)]
    image = splatting.render(*parameters, camera, 3, torch.zeros(3, dtype=torch.float64), NEAR)
    (image * torch.from_numpy(v_image)).sum().backward()
    gradients = image_gradient(double(gaussians), native_view(camera), 3, np.zeros(3), v_image, 2)[1]
    ratios = gaussians.means[:, 0] / (gaussians.means[:, 2] + 3)
    assert (np.abs(ratios) > 1.3 * 20 / camera.fx).sum() > 4
    assert np.linalg.norm(gradients["v_means"]) > 0
    expected = parameters[0].grad.numpy()
    assert np.linalg.norm(gradients["v_means"] - expected) <= 1e-9 * np.linalg.norm(expected)


def test_case_08_a_zero_quaternion_is_culled_and_counted() -> None:
    gaussians, camera = scene(5, seed=0), camera_at(20, 20)
    gaussians.quats[2] = 0
    assert rasterizer.render(gaussians, camera, near_su=NEAR).culled["degenerate"] == 1
    assert assert_step_stays_finite(gaussians, camera).culled["degenerate"] == 1


@pytest.mark.parametrize("length", [1e-20, 1e-6, 1e6, 1e20, 1e37])
def test_case_08_the_length_of_a_quaternion_changes_nothing(length: float) -> None:
    camera, gaussians = camera_at(31, 31), lone()
    gaussians.log_scales[:] = np.log([0.5, 0.1, 0.2])
    reference = rasterizer.render(gaussians, camera, near_su=NEAR)
    gaussians.quats[:] *= np.float32(length)
    rendered = rasterizer.render(gaussians, camera, near_su=NEAR)
    assert rendered.n_visible == 1
    np.testing.assert_allclose(rendered.image, reference.image, atol=1e-5)
    assert_step_stays_finite(gaussians, camera)


@pytest.mark.parametrize("logit", [-5.6, -5.5413, -5.5412, -5.0, -500.0])
def test_case_17_opacity_below_the_cut_is_culled_and_counted(logit: float) -> None:
    faint = bool(1 / (1 + np.exp(-np.float64(np.float32(logit)))) < 1 / 255)
    camera, gaussians = camera_at(20, 20), lone(logit=logit)
    assert rasterizer.render(gaussians, camera, near_su=NEAR).culled["faint"] == faint
    assert_step_stays_finite(gaussians, camera)


def test_case_20_nothing_visible_gives_the_background() -> None:
    """No Gaussians, or all behind the camera."""
    camera = camera_at(17, 9)
    behind = scene(4, seed=0)
    behind.means[:, 2] = -10
    for gaussians in (behind[:0], behind):
        rendered = rasterizer.render(gaussians, camera, background=(0.25, 0.5, 0.75))
        assert np.array_equal(rendered.image, np.broadcast_to(np.float32([0.25, 0.5, 0.75]), (9, 17, 3)))
        assert (rendered.transmittance == 1).all()
        assert not rendered.depth.any()
        gradients = loss_and_gradients(gaussians, camera, target_of(camera))
        assert gradients.finite
        assert not gradients.v_means.any()
        report, _, statistics = step(gaussians, camera)
        assert report.finite
        assert report.n_visible == 0
        assert not statistics.count.any()
        assert len(rasterizer.accumulate_weights(gaussians, camera, np.ones((9, 17), np.uint16)).rows) == 0
        assert rasterizer.render_values(gaussians, camera, np.zeros((len(gaussians), 7), np.float32)).image.shape == (
            9,
            17,
            7,
        )


@pytest.mark.parametrize("width", SIZES)
@pytest.mark.parametrize("height", SIZES)
def test_case_21_images_of_any_size_are_exact(width: int, height: int) -> None:
    """Against the reference without tiles, to the last row and column."""
    camera, gaussians = camera_at(width, height), scene(12, seed=1)
    with torch.no_grad():
        parameters = [torch.from_numpy(a) for a in double(gaussians)]
        expected = splatting.render(*parameters, camera, 3, torch.ones(3, dtype=torch.float64), NEAR).numpy()
    exact = _native.render(double(gaussians), native_view(camera), 3, np.ones(3), 2)[0]
    assert exact.shape == (height, width, 3)
    assert np.abs(exact - expected).max() < 1e-10
    single = rasterizer.render(gaussians, camera, background=(1, 1, 1), near_su=NEAR).image
    assert all_finite(single)
    assert (np.abs(single - expected).max(-1) > 1e-3).mean() <= 1e-2
    assert_step_stays_finite(gaussians, camera)
