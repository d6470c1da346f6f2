# SPDX-License-Identifier: Apache-2.0
"""PSNR, SSIM and plant region, against values worked out by hand."""

import math

import numpy as np
import pytest

from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians.metrics import mean_known, plant_region, psnr_db, ssim_map, to_uint8, view_quality
from cotton3dg.gaussians.views import View
from cotton3dg.geometry.camera_orbit import Orbit


def noise(seed: int, shape: tuple[int, int] = (40, 50)) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (*shape, 3)).astype(np.uint8)


def camera_at(centre: np.ndarray, target: np.ndarray, name: str = "a") -> Camera:
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Camera(name, 64, 48, 60.0, 60.0, 32.0, 24.0, np.column_stack([rotation, -rotation @ centre]))


def test_psnr_of_a_known_error() -> None:
    image = np.full((10, 10, 3), 100, np.uint8)
    assert psnr_db(image, image + np.uint8(10)) == pytest.approx(20 * math.log10(25.5))


def test_psnr_of_a_region_ignores_the_rest() -> None:
    image, other = np.full((10, 10, 3), 100, np.uint8), np.full((10, 10, 3), 101, np.uint8)
    other[0] = 255
    region = np.ones((10, 10), bool)
    region[0] = False
    assert psnr_db(image, other, region) == pytest.approx(20 * math.log10(255))
    assert math.isnan(psnr_db(image, other, np.zeros((10, 10), bool)))


def test_psnr_of_equal_images_is_finite_and_above_any_other() -> None:
    image = noise(0)
    other = image.copy()
    other[0, 0, 0] ^= 1
    assert math.isfinite(psnr_db(image, image))
    assert psnr_db(image, image) > psnr_db(image, other)


def test_rounding_survives_hostile_values() -> None:
    values = np.array([[[np.nan, np.inf, -np.inf], [0.5, 1 / 255, 2.0]]])
    np.testing.assert_array_equal(to_uint8(values), [[[0, 255, 0], [128, 1, 255]]])


def test_ssim_is_one_for_equal_images_and_falls_with_noise() -> None:
    image = noise(1)
    np.testing.assert_allclose(ssim_map(image, image), 1.0)
    assert ssim_map(image, noise(2)).mean() < 0.1
    flat = np.full((20, 20, 3), 77, np.uint8)
    np.testing.assert_allclose(ssim_map(flat, flat), 1.0)


def test_ssim_of_flat_images_has_the_closed_form() -> None:
    first, second = np.full((30, 30, 3), 50, np.uint8), np.full((30, 30, 3), 200, np.uint8)
    c1 = (0.01 * 255) ** 2
    np.testing.assert_allclose(ssim_map(first, second), (2 * 50 * 200 + c1) / (50**2 + 200**2 + c1), rtol=1e-6)


@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (7, 5), (10, 10)])
def test_ssim_of_tiny_images_is_finite(shape: tuple[int, int]) -> None:
    similarity = ssim_map(noise(3, shape), noise(4, shape))
    assert similarity.shape == shape
    assert np.isfinite(similarity).all()
    assert (similarity <= 1 + 1e-9).all()


def test_plant_region_is_the_ball_at_its_depth() -> None:
    target = np.array([0.0, 0.0, 0.0])
    camera = camera_at(np.array([0.0, -5.0, 0.0]), target)
    depth = np.full((48, 64), 5.0)
    depth[:, :32] = 9.0
    region = plant_region(camera, depth, target, 1.0)
    # At depth 5 a pixel is 1/12 su, so the ball is a disc of 12 px, half of it right of the middle.
    assert region.sum() == pytest.approx(math.pi * 12**2 / 2, rel=0.05)
    assert not region[:, :32].any()
    depth[:] = np.nan
    assert not plant_region(camera, depth, target, 1.0).any()


def test_view_quality_of_a_black_render() -> None:
    nothing = Gaussians(*(np.zeros(s, np.float32) for s in ((0, 3), (0, 4), (0, 3), (0,), (0, 1, 3))))
    camera = camera_at(np.array([0.0, -5.0, 0.0]), np.zeros(3))
    around = Orbit(np.zeros(3), np.array([0.0, 0, 1]), 5.0, 5.0, 360.0, 10.0)
    quality = view_quality(nothing, View(camera, np.full((48, 64, 3), 255, np.uint8)), around)
    assert quality.psnr_db == pytest.approx(0.0)
    assert math.isnan(quality.plant_psnr_db)
    assert quality.plant_share == 0.0


def test_a_model_that_lacks_the_plant_is_judged_where_the_plant_is() -> None:
    nothing = Gaussians(*(np.zeros(s, np.float32) for s in ((0, 3), (0, 4), (0, 3), (0,), (0, 1, 3))))
    camera = camera_at(np.array([0.0, -5.0, 0.0]), np.zeros(3))
    photo, plant = np.zeros((48, 64, 3), np.uint8), np.zeros((48, 64), bool)
    photo[10:20, 10:20], plant[10:20, 10:20] = 51, True
    quality = view_quality(nothing, View(camera, photo), plant)
    assert quality.plant_psnr_db == pytest.approx(20 * math.log10(5))
    assert quality.plant_share == pytest.approx(100 / (48 * 64))
    assert quality.psnr_db > quality.plant_psnr_db


def test_the_mean_of_what_is_known() -> None:
    assert mean_known(iter([1.0, math.nan, 3.0])) == 2.0
    assert math.isnan(mean_known([math.nan]))
