# SPDX-License-Identifier: Apache-2.0
"""Small made scenes for the tests of the native core."""

from __future__ import annotations

import numpy as np

from cotton3dg import _native
from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians import rasterizer
from cotton3dg.gaussians.state import arrays_of

NEAR = 0.05
RATES = rasterizer.LearningRates(1e-3, 1e-3, 5e-3, 0.05, 2.5e-3, 1.25e-4)
SPECIAL = np.array(
    [0, -0.0, 1e-45, -1e-45, 1e-38, 1e-30, -1e-30, 1e-20, 1e-6, 1, -1, 50, -50, 90, -90, 1e6, 1e30, -1e30]
    + [3e38, -3e38, np.inf, -np.inf, np.nan],
    np.float32,
)
"""Values that have broken rasterizers: zeros, denormals, what overflows when squared, infinities, NaN."""


def scene(count: int, seed: int, coefficients: int = 16) -> Gaussians:
    """Gaussians around the origin, within reach of `camera_at`."""
    rng = np.random.default_rng(seed)
    return Gaussians(
        rng.uniform(-1, 1, (count, 3)).astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        np.log(rng.uniform(0.03, 0.3, (count, 3))).astype(np.float32),
        rng.normal(0.5, 1.5, count).astype(np.float32),
        rng.normal(0, 0.3, (count, coefficients, 3)).astype(np.float32),
    )


def round_gaussians(means: np.ndarray, sizes: np.ndarray | float, logit: float = 3.0) -> Gaussians:
    """Black balls.

    Args:
        means: (N, 3).
        sizes: standard deviations, of each or of all.
        logit: of their opacity.
    """
    n = len(means)
    return Gaussians(
        means.astype(np.float32),
        np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        np.broadcast_to(np.log(sizes).astype(np.float32).reshape(-1, 1), (n, 3)).copy(),
        np.full(n, logit, np.float32),
        np.zeros((n, 1, 3), np.float32),
    )


def camera_at(width: int, height: int, angle: float = 0.0, distance: float = 3.0) -> Camera:
    """A camera that looks at the origin from `distance` su, turned around the vertical; its centre is off-axis."""
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    pose = np.concatenate([rotation, [[0.0], [0.0], [distance]]], axis=1)
    focal = 1.1 * max(width, height)
    return Camera("view", width, height, focal, 0.97 * focal, 0.48 * width, 0.53 * height, pose)


def native_view(camera: Camera, near_su: float = NEAR, window: tuple[int, int, int, int] | None = None) -> _native.View:
    return _native.View(
        camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, camera.cam_from_scene, near_su, window
    )


def double(gaussians: Gaussians) -> _native.Arrays:
    return tuple(a.astype(np.float64) for a in arrays_of(gaussians))  # type: ignore[return-value]


def target_of(camera: Camera, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8)


def step(
    gaussians: Gaussians, camera: Camera, **options
) -> tuple[rasterizer.StepReport, rasterizer.AdamState, rasterizer.DensityStatistics]:
    adam, statistics = rasterizer.AdamState.zeros(gaussians), rasterizer.DensityStatistics.zeros(len(gaussians))
    options = {"sh_degree": 3, "learning_rates": RATES, "near_su": NEAR, "target": target_of(camera)} | options
    return rasterizer.train_step(gaussians, adam, statistics, camera, **options), adam, statistics


def all_finite(*arrays: np.ndarray) -> bool:
    return all(np.isfinite(a).all() for a in arrays)


def assert_step_stays_finite(gaussians: Gaussians, camera: Camera, **options) -> rasterizer.StepReport:
    """Takes a step; what was finite before must be finite after."""
    before = [a.copy() for a in arrays_of(gaussians)]
    report, adam, statistics = step(gaussians, camera, **options)
    for old, new in zip(before, arrays_of(gaussians), strict=True):
        assert np.isfinite(new[np.isfinite(old)]).all()
    assert all_finite(*arrays_of(adam.first), *arrays_of(adam.second), *vars(statistics).values())
    return report
