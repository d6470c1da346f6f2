# SPDX-License-Identifier: Apache-2.0
"""The poison grid and random scenes, forward and backward: what must hold for every Gaussian model there is.

COTTON3DG_SCENES sets how many random scenes are drawn; 1000 unless told, 10,000 for a full run. `make test` draws the
first 100 of them.
"""

from __future__ import annotations

import os

import numpy as np
import pytest
from scenes.differentiation import image_gradient, loss_and_gradients
from scenes.splat_scenes import (
    NEAR,
    SPECIAL,
    all_finite,
    arrays_of,
    assert_step_stays_finite,
    camera_at,
    double,
    native_view,
    scene,
    target_of,
)

from cotton3dg import _native
from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians import rasterizer

N_SCENES = int(os.environ.get("COTTON3DG_SCENES", "1000"))
QUICK, PART = 100, 50
"""Random scenes that are drawn in any case, and those of one test."""
PARTS = [pytest.param(first, marks=pytest.mark.slow if first >= QUICK else ()) for first in range(0, N_SCENES, PART)]
NAMES = ("v_means", "v_quats", "v_log_scales", "v_opacity_logits", "v_sh")


def assert_gradients_stay_finite(gaussians: Gaussians, camera: Camera) -> None:
    gradients = loss_and_gradients(gaussians, camera, target_of(camera), near_su=NEAR)
    assert gradients.finite
    assert all_finite(*(getattr(gradients, name) for name in NAMES))


@pytest.mark.parametrize(("slot", "size"), [("means", 3), ("quats", 4), ("log_scales", 3), ("opacity_logits", 1)])
@pytest.mark.parametrize("value", SPECIAL)
def test_poison_grid(slot: str, size: int, value: np.float32) -> None:
    """Every number that a Gaussian consists of, times every special value: it harms at most that Gaussian."""
    camera = camera_at(40, 30)
    clean = rasterizer.render(scene(20, seed=0)[1:], camera, near_su=NEAR)
    for k in range(size):
        check_poisoned(slot, k, value, camera, clean)


@pytest.mark.parametrize("value", SPECIAL)
def test_poison_grid_of_colours(value: np.float32) -> None:
    camera = camera_at(40, 30)
    clean = rasterizer.render(scene(20, seed=0)[1:], camera, near_su=NEAR)
    for k in range(48):
        check_poisoned("sh", k, value, camera, clean)


def check_poisoned(slot: str, k: int, value: np.float32, camera: Camera, clean: rasterizer.Rendered) -> None:
    gaussians = scene(20, seed=0)
    getattr(gaussians, slot).reshape(20, -1)[0, k] = value
    rendered = rasterizer.render(gaussians, camera, near_su=NEAR)
    assert all_finite(rendered.image, rendered.transmittance, rendered.depth)
    assert rendered.n_visible + sum(rendered.culled.values()) == 20
    if not np.isfinite(value):
        assert rendered.culled["non_finite"] == 1
        assert np.array_equal(rendered.image, clean.image)
    assert_gradients_stay_finite(gaussians, camera)
    assert assert_step_stays_finite(gaussians, camera).finite


def test_valid_extremes_stay_visible() -> None:
    """Culling everything is no way to pass: what is extreme but valid is drawn."""
    camera = camera_at(31, 31)
    for log_scale, quat, logit in (
        (25.0, 1.0, 4.0), (90.0, 1.0, 4.0), (-30.0, 1.0, 4.0), (-90.0, 1.0, 4.0), (-2.0, 1e-20, 4.0),
        (-2.0, 1e20, 4.0), (-2.0, 1.0, 90.0), (-2.0, 1.0, 3e38), (3e38, 1.0, 4.0), (-3e38, 1.0, 4.0),
    ):  # fmt: skip
        gaussians = scene(1, seed=0)
        gaussians.means[:] = 0
        gaussians.opacity_logits[:] = logit
        gaussians.log_scales[:] = log_scale
        gaussians.quats[:] *= quat
        rendered = rasterizer.render(gaussians, camera, near_su=NEAR)
        assert rendered.n_visible == 1
        assert rendered.transmittance.min() < 0.5, (log_scale, quat, logit)


def random_camera(rng: np.random.Generator) -> Camera:
    size = rng.integers(1, 60, 2).tolist()
    return camera_at(*size, angle=rng.uniform(-3, 3), distance=float(rng.choice([0.0, 0.5, 3.0, 30.0])))


@pytest.mark.parametrize("first", PARTS)
def test_random_poisoned_scenes_stay_finite(first: int) -> None:
    """Any mixture of special values in all slots, seen from inside and outside."""
    for seed in range(first, min(first + PART, N_SCENES)):
        rng = np.random.default_rng(seed)
        gaussians = scene(int(rng.integers(0, 60)), seed, int(rng.choice([1, 4, 9, 16])))
        for array in arrays_of(gaussians):
            poisoned = rng.random(array.shape) < rng.choice([0.002, 0.05, 0.5])
            array[poisoned] = rng.choice(SPECIAL, poisoned.sum())
        camera = random_camera(rng)
        rendered = rasterizer.render(gaussians, camera, near_su=NEAR)
        assert all_finite(rendered.image, rendered.transmittance, rendered.depth), seed
        assert rendered.n_visible + sum(rendered.culled.values()) == len(gaussians), seed
        assert_step_stays_finite(gaussians, camera, sh_degree=gaussians.sh_degree)


@pytest.mark.parametrize("first", PARTS)
def test_random_scenes_in_float_match_double(first: int, record_property) -> None:
    """Valid scenes: pixels that differ are rare, and gradients agree wherever no pixel flips."""
    flipped = pixels = compared = 0
    worst = 0.0
    for seed in range(first, min(first + PART, N_SCENES)):
        rng = np.random.default_rng([seed, 1])
        gaussians = scene(int(rng.integers(1, 40)), seed)
        gaussians.log_scales[:] += rng.uniform(-2, 2)
        gaussians.opacity_logits[:] += rng.uniform(-3, 3)
        size = rng.integers(8, 60, 2).tolist()
        camera = camera_at(*size, angle=rng.uniform(-3, 3))
        view, background = native_view(camera), rng.uniform(size=3)
        single_image = _native.render(arrays_of(gaussians), view, 3, background.astype(np.float32), 1)[0]
        exact_image = _native.render(double(gaussians), view, 3, background, 1)[0]
        differs = np.abs(single_image - exact_image).max(-1) > 1e-4 * max(1.0, float(np.abs(exact_image).max()))
        flipped, pixels = flipped + int(differs.sum()), pixels + differs.size
        if differs.any():
            continue
        compared += 1
        v_image = rng.normal(size=exact_image.shape)
        exact = image_gradient(double(gaussians), view, 3, background, v_image, 1)[1]
        single = image_gradient(
            arrays_of(gaussians), view, 3, background.astype(np.float32), v_image.astype(np.float32), 1
        )[1]
        largest = max(float(np.linalg.norm(exact[key])) for key in NAMES)
        for key in NAMES:
            scale = max(float(np.linalg.norm(exact[key])), 1e-3 * largest, 1e-30)
            worst = max(worst, float(np.linalg.norm(single[key] - exact[key])) / scale)
    record_property("random scenes, share of flipped pixels (<= 1e-3)", flipped / pixels)
    record_property("random scenes, float gradients against double (<= 1e-4)", worst)
    assert flipped <= 1e-3 * pixels
    assert worst <= 1e-4
    assert compared > 0.8 * PART
