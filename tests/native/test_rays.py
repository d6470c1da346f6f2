# SPDX-License-Identifier: Apache-2.0
"""The blending weights of single pixels: the same that rendering uses."""

from __future__ import annotations

import numpy as np
import pytest
import splatting
import torch
from scenes.splat_scenes import NEAR, arrays_of, camera_at, double, native_view, scene
from scipy import sparse

from cotton3dg import _native
from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians import rasterizer


def matrix(gaussians: Gaussians, camera: Camera, pixels: np.ndarray, threads: int = 0) -> sparse.csr_matrix:
    rays = rasterizer.ray_weights(gaussians, camera, pixels, near_su=NEAR, threads=threads)
    return sparse.csr_matrix((rays.weights, rays.rows, rays.starts), shape=(len(pixels), len(gaussians)))


def all_pixels(camera: Camera) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).reshape(-1, 2)


def test_products_are_renders(instruction_set) -> None:
    camera, gaussians = camera_at(70, 50), scene(400, seed=3)
    rng = np.random.default_rng(1)
    values = rng.uniform(0, 1, (400, 4)).astype(np.float32)
    weights = matrix(gaussians, camera, all_pixels(camera))
    rendered = rasterizer.render_values(gaussians, camera, values, near_su=NEAR)
    assert np.abs(weights @ values - rendered.image.reshape(-1, 4)).max() <= 1e-6
    np.testing.assert_allclose(1 - weights.sum(axis=1).A1, rendered.transmittance.ravel(), atol=2e-6)


def test_any_pixels_in_any_order(instruction_set) -> None:
    """Also those of the cut tiles at the edges, and the same one twice."""
    camera, gaussians = camera_at(37, 29), scene(150, seed=4)
    everything = matrix(gaussians, camera, all_pixels(camera)).toarray()
    pixels = np.random.default_rng(2).integers(0, (37, 29), (200, 2))
    pixels[:4] = [[36, 28], [0, 0], [36, 28], [36, 0]]
    some = matrix(gaussians, camera, pixels).toarray()
    assert np.array_equal(some, everything[pixels[:, 1] * 37 + pixels[:, 0]])
    assert len(rasterizer.ray_weights(gaussians, camera, np.zeros((0, 2), int)).rows) == 0


def test_rays_go_front_to_back_whatever_the_threads() -> None:
    camera, gaussians = camera_at(64, 48), scene(300, seed=5)
    one, three = (rasterizer.ray_weights(gaussians, camera, all_pixels(camera), threads=n) for n in (1, 3))
    for name in ("starts", "rows", "weights"):
        assert np.array_equal(getattr(one, name), getattr(three, name))
    depths = camera.project(gaussians.means)[1][one.rows]
    ray = np.repeat(np.arange(64 * 48), np.diff(one.starts))
    assert (np.diff(depths)[np.diff(ray) == 0] >= -1e-5).all()
    assert (one.weights > 0).all()


def test_weights_are_those_of_the_reference(instruction_set) -> None:
    camera, gaussians = camera_at(20, 17), scene(60, seed=6)
    pixels = all_pixels(camera)
    starts, rows, weights = _native.ray_weights(double(gaussians), native_view(camera), pixels, 1)
    found = sparse.csr_matrix((weights, rows, starts), shape=(len(pixels), 60)).toarray()
    geometry = [torch.from_numpy(a) for a in double(gaussians)[:4]]
    black = torch.zeros(60, dtype=torch.float64)
    expected = splatting.blend(*geometry, torch.eye(60, dtype=torch.float64), camera, black, NEAR)[0]
    assert weights.dtype == np.float64
    np.testing.assert_allclose(found, expected.reshape(-1, 60).numpy(), atol=1e-10)


def test_pixels_outside_the_image_are_refused() -> None:
    camera, gaussians = camera_at(20, 17), scene(5, seed=7)
    for pixel in ([20, 0], [0, 17], [-1, 3]):
        with pytest.raises(ValueError, match="in the image"):
            rasterizer.ray_weights(gaussians, camera, np.array([pixel]))
    with pytest.raises(ValueError, match="integers"):
        rasterizer.ray_weights(gaussians, camera, np.zeros((1, 2)))
    with pytest.raises(ValueError, match="pixels"):
        rasterizer.ray_weights(gaussians, camera, np.zeros((1, 3), int))
    with pytest.raises(TypeError, match="means"):
        _native.ray_weights(
            tuple(a.astype(np.float16) for a in arrays_of(gaussians)),
            native_view(camera),
            np.zeros((1, 2), np.int64),
            1,
        )
