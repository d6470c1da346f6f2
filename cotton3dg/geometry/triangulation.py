# SPDX-License-Identifier: Apache-2.0
"""A point in space from its places in several photos; some of these places may be wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float64

LEAST_ANGLE: Final = np.radians(3.0)
"""Least angle between two rays that may suggest a point; rays at a smaller angle give its depth badly."""
HYPOTHESES: Final = 200
FULL_WIDTH_PX: Final = 1280
"""Width above which the tolerance of a photo grows with its width, because structure from motion errs by angles."""
PICK_PX: Final = 1.0
"""Standard error of a place picked by hand."""
SLIP_PX: Final = 6.0
"""Largest distance of a pick from the point on which the others agree. A pick farther off is a slip."""


@dataclass(frozen=True)
class Sighting:
    """A point with its evidence."""

    point: Float64
    """(3,) su."""
    agreeing: NDArray[np.bool_]
    """(V,) views that see it where it is."""
    residual_px: float
    """Root mean square distance in them."""
    su_per_px: float
    """Standard error of the point's place, mean of three axes, if each view errs by a pixel in x and in y."""


@dataclass(frozen=True)
class PickedPoint:
    """The point where places that a person picked by hand meet."""

    point: Float64
    """(3,) su."""
    error_su: float
    """Standard error of its place, mean of three axes."""


def triangulate(
    cameras: Sequence[Camera], pixels: NDArray[Any], *, tolerance_px: float = 1.0, least_views: int = 2, seed: int = 0
) -> Sighting | None:
    """The point that most views see within `tolerance_px`.

    RANSAC over pairs of views (Fischler and Bolles 1981), then least squares of the distances in the photos over the
    views that agree.

    Args:
        pixels: (V, 2) px, one of each camera.
        tolerance_px: at a width of `FULL_WIDTH_PX` or less.
    Returns:
        None when fewer than `least_views` views, or fewer than half of them, agree.
    """
    pixels = np.asarray(pixels, np.float64)
    if len(cameras) < max(least_views, 2):
        return None
    poses = np.stack([camera.cam_from_scene for camera in cameras])
    focal = np.array([[camera.fx, camera.fy] for camera in cameras])
    flat = (pixels - np.array([[camera.cx, camera.cy] for camera in cameras])) / focal
    reach = tolerance_px * np.maximum(1.0, np.array([camera.width for camera in cameras]) / FULL_WIDTH_PX)
    rays = np.einsum("vji,vj->vi", poses[:, :, :3], np.column_stack([flat, np.ones(len(flat))]))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    best: NDArray[np.bool_] | None = None
    for pair in _pairs(len(cameras), seed):
        if rays[pair[0]] @ rays[pair[1]] > np.cos(LEAST_ANGLE):
            continue
        point = _solve_linear(poses[pair], flat[pair])
        agreeing = _distances(point, poses, flat, focal) < reach
        if best is None or agreeing.sum() > best.sum():
            best = agreeing
    # The pair's own point is rough, so agreeing views are counted again around the point of all that agreed.
    for _ in range(2):
        if best is None or best.sum() < max(least_views, 2):
            return None
        point = _least_squares(poses[best], flat[best], focal[best])
        best = _distances(point, poses, flat, focal) < reach
    if best is None or best.sum() < max(least_views, 2, len(cameras) / 2):
        return None
    residual_px = float(np.sqrt(np.mean(_distances(point, poses[best], flat[best], focal[best]) ** 2)))
    _, slopes = _residuals(point, poses[best], flat[best], focal[best])
    covariance = np.linalg.pinv(slopes.T @ slopes)
    return Sighting(point, best, residual_px, float(np.sqrt(np.trace(covariance) / 3)))


def point_of_picks(cameras: Sequence[Camera], pixels: Float64) -> PickedPoint | None:
    """The point that picks show; None where they do not meet in space.

    Args:
        cameras: one a pick. pixels: (P, 2) px.
    """
    sighting = triangulate(cameras, pixels, tolerance_px=SLIP_PX)
    if sighting is None:
        return None
    # Two picks meet by chance, so the error is at least that of a hand, even with smaller residuals.
    return PickedPoint(sighting.point, sighting.su_per_px * max(PICK_PX, sighting.residual_px))


def _pairs(count: int, seed: int) -> list[NDArray[np.int64]]:
    """Pairs of views: all, or `HYPOTHESES` of them."""
    pairs = np.array(list(combinations(range(count), 2)))
    if len(pairs) > HYPOTHESES:
        pairs = pairs[np.random.default_rng(seed).choice(len(pairs), HYPOTHESES, replace=False)]
    return list(pairs)


def _solve_linear(poses: Float64, flat: Float64) -> Float64:
    """(3,) su: the point whose projections miss least, not weighted by distance."""
    matrix = (flat[:, :, None] * poses[:, 2:3] - poses[:, :2]).reshape(-1, 4)
    return np.asarray(np.linalg.lstsq(matrix[:, :3], -matrix[:, 3], rcond=None)[0], np.float64)


def _least_squares(poses: Float64, flat: Float64, focal: Float64) -> Float64:
    """(3,) su: linear estimate, then Gauss-Newton on the distances in the photos."""
    point = _solve_linear(poses, flat)
    for _ in range(4):
        residuals, slopes = _residuals(point, poses, flat, focal)
        if not np.isfinite(residuals).all():
            break
        point = point - np.linalg.lstsq(slopes, residuals, rcond=None)[0]
    return point


def _residuals(point: Float64, poses: Float64, flat: Float64, focal: Float64) -> tuple[Float64, Float64]:
    """(2 V,) distances in px, and their slopes (2 V, 3) by the point."""
    places = poses[:, :, :3] @ point + poses[:, :, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = places[:, :2] / places[:, 2:]
        slopes = (poses[:, :2, :3] - seen[:, :, None] * poses[:, 2:, :3]) / places[:, 2, None, None]
    return ((seen - flat) * focal).ravel(), (slopes * focal[:, :, None]).reshape(-1, 3)


def _distances(point: Float64, poses: Float64, flat: Float64, focal: Float64) -> Float64:
    """(V,) px; infinite in views that have the point behind them."""
    residuals = _residuals(point, poses, flat, focal)[0].reshape(-1, 2)
    ahead = poses[:, 2, :3] @ point + poses[:, 2, 3] > 0
    return np.where(ahead & np.isfinite(residuals).all(axis=1), np.linalg.norm(residuals, axis=1), np.inf)
