# SPDX-License-Identifier: Apache-2.0
"""From the Gaussians of a body to points on its surface."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Gaussians, rotations
from ..geometry.boxes import fibonacci_directions
from ..geometry.convex_measures import convex_volume

MIN_OPACITY: Final = 0.1
"""Fainter Gaussians are haze and not surface."""
SAMPLES: Final = 32
"""Points on each ellipsoid."""
DILATION_PX2: Final = 0.3
"""The renderer adds this to both variances of every projected Gaussian (native/src/scene.h)."""


def dilate_gaussians(gaussians: Gaussians, pixel_su: float) -> Gaussians:
    """Gaussians as wide as the images show them.

    The training fits the drawn image, and the renderer draws everything half a pixel wider than it is. A body of the
    saved Gaussians is therefore too small by 10 % of a boll's volume at 960 px and by 15 % at 480 px.

    Args:
        pixel_su: width of a pixel of the training images at the plant.
    """
    variances = np.exp(2 * gaussians.log_scales.astype(np.float64)) + DILATION_PX2 * pixel_su**2
    return replace(gaussians, log_scales=(0.5 * np.log(variances)).astype(np.float32))


def surface_rows(gaussians: Gaussians) -> NDArray[np.bool_]:
    """Which Gaussians of one compact body lie on or in it.

    Dropped are faint ones and outliers beyond 3.5 robust standard deviations (MAD) of the distance from the middle or
    of the size, on the large side only.
    """
    kept = gaussians.finite_rows & (gaussians.opacities >= MIN_OPACITY)
    if not kept.any():
        return kept
    means = gaussians.means.astype(np.float64)
    distances = np.linalg.norm(means - np.median(means[kept], axis=0), axis=1)
    sizes = gaussians.log_scales.max(axis=1).astype(np.float64)
    return kept & _not_above(distances, kept, floor=0.05) & _not_above(sizes, kept, floor=0.0)


def sample_surface(gaussians: Gaussians, sigmas: float | NDArray[Any], samples: int = SAMPLES) -> NDArray[np.float64]:
    """(N * samples, 3) su: points on the ellipsoids at `sigmas` standard deviations, one number for all or one each."""
    on_sphere = fibonacci_directions(samples)
    extents = gaussians.scales * np.reshape(sigmas, (-1, 1))
    offsets = np.einsum("nij,nsj->nsi", rotations(gaussians.quats), extents[:, None, :] * on_sphere)
    points: NDArray[np.float64] = (gaussians.means[:, None, :] + offsets).reshape(-1, 3)
    return points


def sample_visible_surface(gaussians: Gaussians, opaque: float) -> NDArray[np.float64]:
    """(P * SAMPLES, 3) su: points where each Gaussian alone has the opacity `opaque`; fainter Gaussians have none."""
    opacities = gaussians.opacities.astype(np.float64)
    rows = opacities > opaque
    return sample_surface(gaussians[rows], np.sqrt(2 * np.log(opacities[rows] / opaque)))


def sample_surface_of_volume(gaussians: Gaussians, volume: float) -> NDArray[np.float64]:
    """Points on the ellipsoids at the size at which their common convex hull has the given volume, su."""
    low, high = 0.0, 4.0
    # Bisection, to 4 / 2^8 standard deviations.
    for _ in range(8):
        middle = (low + high) / 2
        inside = convex_volume(sample_surface(gaussians, middle)).value < volume
        low, high = (middle, high) if inside else (low, middle)
    return sample_surface(gaussians, high)


def _not_above(values: NDArray[Any], among: NDArray[np.bool_], floor: float) -> NDArray[np.bool_]:
    """Which values are not more than 3.5 robust standard deviations above the median of those `among`."""
    median = np.median(values[among])
    spread = 1.4826 * np.median(np.abs(values[among] - median))
    low: NDArray[np.bool_] = values <= median + 3.5 * max(spread, floor * abs(median))
    return low
