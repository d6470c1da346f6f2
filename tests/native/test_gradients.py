# SPDX-License-Identifier: Apache-2.0
"""The native core in float64 against the torch twin and finite differences, and in float32 against float64."""

from __future__ import annotations

import numpy as np
import pytest
import splatting
import torch
from scenes.differentiation import image_gradient, view_gradients
from scenes.splat_scenes import NEAR, arrays_of, camera_at, double, native_view, scene
from scipy import sparse

from cotton3dg import _native
from cotton3dg.core.scene import Camera, Gaussians

NAMES = ("v_means", "v_quats", "v_log_scales", "v_opacity_logits", "v_sh")
PIXEL_SEED = 5
ORDINARY = ("ordinary", "quaternion lengths", "oblique camera")


def tensors(gaussians: Gaussians) -> list[torch.Tensor]:
    return [torch.from_numpy(a).requires_grad_() for a in double(gaussians)]


def relative(a: np.ndarray, b: np.ndarray) -> float:
    """Relative L2 distance, of tensors that may be zero."""
    return float(np.linalg.norm(a - b) / max(np.linalg.norm(b), 1e-300)) if np.any(b) or np.any(a) else 0.0


def hard_scenes() -> dict[str, tuple[Gaussians, Camera]]:
    camera = camera_at(41, 37)
    needles = scene(12, seed=1)
    needles.log_scales[:, 0] = np.log(np.geomspace(0.5, 200, 12))
    needles.log_scales[:, 1:] = np.log(1e-4)
    opaque = scene(16, seed=2)
    opaque.means[:, :2] = 0.05 * opaque.means[:, :2]
    opaque.opacity_logits[:] = np.linspace(3, 12, 16)
    opaque.log_scales[:] = np.log([0.3, 0.35, 0.5])
    beyond = scene(10, seed=3)
    beyond.means[:] = np.random.default_rng(3).uniform(-1, 1, (10, 3))
    beyond.means[:, 0] = beyond.means[:, 0] + np.where(np.arange(10) % 2, 3.5, -3.5)
    beyond.log_scales[:] = np.log([1.2, 0.9, 1.5])
    dense = scene(60, seed=4)
    dense.opacity_logits[:] += 2
    scaled_quats = scene(20, seed=6)
    scaled_quats.quats[:] *= np.geomspace(1e-3, 1e3, 20, dtype=np.float32)[:, None]
    return {
        "ordinary": (scene(40, seed=0), camera),
        "needles": (needles, camera),
        "opaque stack": (opaque, camera),
        "beyond the frustum": (beyond, camera),
        "early stop": (dense, camera),
        "quaternion lengths": (scaled_quats, camera),
        "oblique camera": (scene(30, seed=7), camera_at(33, 18, angle=0.8)),
    }


def bound(name: str) -> float:
    """Of the relative error of double gradients. The covariances of needles have condition numbers up to 4e12, so that
    which instructions multiply and add at once decides what is left of the digits: 0.7e-9 to 1.1e-9 were seen, of the
    other scenes at most 4e-14."""
    return 1e-8 if name == "needles" else 1e-12


@pytest.mark.parametrize("name", hard_scenes())
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_image_and_gradients_match_autograd(name: str, degree: int, record_property) -> None:
    gaussians, camera = hard_scenes()[name]
    background = np.random.default_rng(8).uniform(0, 1, 3)
    v_image = np.random.default_rng(PIXEL_SEED).normal(size=(camera.height, camera.width, 3))
    parameters = tensors(gaussians)
    image = splatting.render(*parameters, camera, degree, torch.from_numpy(background), NEAR)
    (image * torch.from_numpy(v_image)).sum().backward()

    view = native_view(camera)
    native_image = _native.render(double(gaussians), view, degree, background, 2)[0]
    assert np.abs(native_image - image.detach().numpy()).max() < 1e-11
    finite, gradients = image_gradient(double(gaussians), view, degree, background, v_image, 2)
    assert finite
    for key, parameter in zip(NAMES, parameters, strict=True):
        expected = np.zeros(parameter.shape) if parameter.grad is None else parameter.grad.numpy()
        record_property(f"double gradients against autograd (<= {bound(name):g})", relative(gradients[key], expected))
        assert relative(gradients[key], expected) < bound(name), key


@pytest.mark.parametrize("name", hard_scenes())
def test_gradients_match_finite_differences(name: str, record_property) -> None:
    gaussians, camera = hard_scenes()[name]
    background = np.array([0.1, 0.5, 0.9])
    rng = np.random.default_rng(PIXEL_SEED)
    v_image = rng.normal(size=(camera.height, camera.width, 3))
    arrays, view = double(gaussians), native_view(camera)
    gradients = image_gradient(arrays, view, 3, background, v_image, 2)[1]

    def objective(*shifted: np.ndarray) -> float:
        return float((_native.render(shifted, view, 3, background, 2)[0] * v_image).sum())

    errors = []
    for k, key in enumerate(NAMES):
        for _ in range(4):
            direction = rng.normal(size=arrays[k].shape) * np.maximum(np.abs(arrays[k]).mean(-1, keepdims=True), 1e-3)
            slope = float((gradients[key] * direction).sum())
            best = np.inf
            for step in (1e-5, 1e-6, 1e-7):  # a step across a discontinuity is bad luck, not an error
                ends = [list(arrays), list(arrays)]
                ends[0][k], ends[1][k] = arrays[k] + step * direction, arrays[k] - step * direction
                difference = (objective(*ends[0]) - objective(*ends[1])) / (2 * step)
                best = min(best, abs(difference - slope) / max(abs(slope), 1e-6 * np.abs(gradients[key]).max()))
            errors.append(best)
    record_property("double gradients against finite differences (<= 1e-5)", max(errors))
    assert max(errors) < 1e-5, errors


@pytest.mark.parametrize("name", hard_scenes())
def test_float_matches_double(name: str, record_property) -> None:
    gaussians, camera = hard_scenes()[name]
    background = np.array([0.2, 0.4, 0.6])
    v_image = np.random.default_rng(PIXEL_SEED).normal(size=(camera.height, camera.width, 3))
    view = native_view(camera)
    exact = image_gradient(double(gaussians), view, 3, background, v_image, 2)[1]
    single = image_gradient(
        arrays_of(gaussians), view, 3, background.astype(np.float32), v_image.astype(np.float32), 2
    )[1]
    kind, bound = ("ordinary", 1e-5) if name in ORDINARY else ("hard", 1e-4)
    for key in NAMES:
        record_property(f"float gradients against double, {kind} (<= {bound:g})", relative(single[key], exact[key]))
        assert relative(single[key], exact[key]) < bound, (key, relative(single[key], exact[key]))
        largest = np.abs(exact[key]).max()
        allowed = 1e-3 * np.abs(exact[key]) + 1e-6 * largest
        share = float((np.abs(single[key] - exact[key]) / np.maximum(allowed, 1e-300)).max()) if largest > 0 else 0.0
        record_property("one number of a float gradient, share of what is allowed (<= 1)", share)
        assert share <= 1, key


@pytest.mark.parametrize("channels", [1, 3, 4, 16, 32])
def test_values_match_autograd(channels: int) -> None:
    gaussians, camera = scene(25, seed=9), camera_at(35, 21)
    rng = np.random.default_rng(1)
    values = torch.from_numpy(rng.normal(size=(25, channels))).requires_grad_()
    background = rng.normal(size=channels)
    v_image = rng.normal(size=(camera.height, camera.width, channels))
    geometry = [torch.from_numpy(a) for a in double(gaussians)[:4]]
    image, transmittance = splatting.blend(*geometry, values, camera, torch.from_numpy(background), NEAR)
    (image * torch.from_numpy(v_image)).sum().backward()
    view = native_view(camera)
    native_image, native_transmittance, _, _ = _native.render_values(
        double(gaussians), values.detach().numpy(), view, background, 2
    )
    assert np.abs(native_image - image.detach().numpy()).max() < 1e-11
    assert np.abs(native_transmittance - transmittance.detach().numpy()).max() < 1e-12
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).reshape(-1, 2)
    starts, rows, weights = _native.ray_weights(double(gaussians), view, pixels, 2)
    of_rays = sparse.csr_matrix((weights, rows, starts), shape=(len(pixels), 25))
    assert relative(of_rays.T @ v_image.reshape(-1, channels), values.grad.numpy()) < 1e-11


@pytest.mark.parametrize("size", [(1, 1), (5, 3), (11, 40), (64, 33)])
def test_loss_matches_autograd(size: tuple[int, int]) -> None:
    width, height = size
    rng = np.random.default_rng(2)
    image = torch.from_numpy(rng.uniform(0, 1, (height, width, 3))).requires_grad_()
    target = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    expected = splatting.loss(image, target, 0.2)
    expected.backward()
    report, v_image = _native.for_tests.image_loss(image.detach().numpy(), target, 0.2, 2)
    assert report["loss"] == pytest.approx(expected.item(), rel=1e-12)
    assert relative(v_image, image.grad.numpy()) < 1e-9


def test_all_of_a_training_step_matches_autograd() -> None:
    gaussians, camera = scene(40, seed=11), camera_at(50, 43)
    target = np.random.default_rng(3).integers(0, 256, (43, 50, 3)).astype(np.uint8)
    parameters = tensors(gaussians)
    background = np.array([0.0, 0.3, 0.8])
    image = splatting.render(*parameters, camera, 2, torch.from_numpy(background), NEAR)
    expected = splatting.loss(image, target, 0.2)
    expected.backward()
    view = native_view(camera)
    report, gradients = view_gradients(double(gaussians), view, 2, background, target, 0.2, 2)
    assert report["loss"] == pytest.approx(expected.item(), rel=1e-12)
    for key, parameter in zip(NAMES, parameters, strict=True):
        assert relative(gradients[key], parameter.grad.numpy()) < 1e-9, key
    single = view_gradients(arrays_of(gaussians), view, 2, background.astype(np.float32), target, 0.2, 2)[1]
    for key in NAMES:
        assert relative(single[key], gradients[key]) < 1e-4, key


@pytest.mark.parametrize("name", hard_scenes())
@pytest.mark.parametrize("window", [(16, 0, 16, 16), (5, 3, 11, 14), (0, 0, 33, 18)])
def test_a_window_is_that_part_of_the_image(name: str, window: tuple[int, int, int, int]) -> None:
    gaussians, camera = hard_scenes()[name]
    left, top, width, height = window
    part = np.s_[top : top + height, left : left + width]
    target = np.random.default_rng(3).integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8)
    parameters = tensors(gaussians)
    background = np.array([0.0, 0.3, 0.8])
    image = splatting.render(*parameters, camera, 2, torch.from_numpy(background), NEAR)
    expected = splatting.loss(image[part], target[part], 0.2)
    (expected * (width * height / (camera.width * camera.height))).backward()
    view = native_view(camera, window=window)
    native_image = _native.render(double(gaussians), view, 2, background, 2)[0]
    assert np.abs(native_image - image[part].detach().numpy()).max() < 1e-11
    report, gradients = view_gradients(double(gaussians), view, 2, background, target, 0.2, 2)
    assert report["loss"] == pytest.approx(expected.item(), rel=1e-12)
    for key, parameter in zip(NAMES, parameters, strict=True):
        assert relative(gradients[key], parameter.grad.numpy()) < (1e-9 if name in ORDINARY else 1e-8), key


@pytest.mark.parametrize("window", [(-1, 0, 5, 5), (0, 0, 0, 5), (30, 0, 4, 5), (0, 15, 5, 4)])
def test_a_window_beyond_the_image_is_refused(window: tuple[int, int, int, int]) -> None:
    with pytest.raises(ValueError, match="window"):
        native_view(camera_at(33, 18), window=window)
