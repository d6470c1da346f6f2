# SPDX-License-Identifier: Apache-2.0
"""Thickness of stem and branches: the width of the silhouette that their Gaussians show from several sides.

Wood ends where the model's opacity is that of a pixel that wood half covers (`edges`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64, Gaussians, rotations
from ..geometry.polylines import nearest_on, path_lengths, place_at

SIDES: Final = 8
EVERY_CM: Final = 1.0
WINDOW_CM: Final = 0.9
"""Distance along the axis beyond which Gaussians do not show at a place."""
REACH_CM: Final = 1.8
RAY_CM: Final = 0.02
MIDDLE_CM: Final = 0.4
"""Largest distance between an axis and the wood through which it runs."""
FAINT: Final = 1e-6
"""Opacity anywhere across an axis below which a Gaussian does not matter there."""
LIKELY_RADIUS_CM: Final = (0.04, 1.5)


def radii_of(
    curves: Sequence[Float64], drawn: Gaussians, plant_from_scene: Float64, foot: Float64, opaque: float
) -> list[Float64]:
    """(N,) cm for each curve (N, 3): half the width across it, median over the sides; NaN where nothing is opaque.

    Args:
        drawn: the plant's Gaussians without its bolls, as wide as they are drawn.
        plant_from_scene: (3, 3) rotation times cm per su. foot: (3,) su, origin of the plant frame.
        opaque: opacity at which wood ends.
    """
    drawn = drawn[drawn.finite_rows & (drawn.opacities > 0.02)]
    means = (drawn.means - foot) @ plant_from_scene.T
    axes = np.einsum("ij,njk->nik", plant_from_scene, rotations(drawn.quats))
    covariances = np.einsum("nij,nj,nkj->nik", axes, drawn.scales.astype(np.float64) ** 2, axes)
    opacities = np.minimum(drawn.opacities.astype(np.float64), 0.9999)
    return [_along(curve, means, covariances, opacities, opaque) for curve in curves]


def _along(curve: Float64, means: Float64, covariances: Float64, opacities: Float64, opaque: float) -> Float64:
    lengths = path_lengths(curve)
    if len(curve) < 3 or lengths[-1] < EVERY_CM:
        return np.full(len(curve), np.nan)
    away, station = nearest_on(curve, means, REACH_CM)
    beside = np.flatnonzero(away < REACH_CM)
    places = np.arange(0.5 * EVERY_CM, lengths[-1], EVERY_CM)
    radii = np.full(len(places), np.nan)
    for number, place in enumerate(places):
        near = beside[np.abs(station[beside] - place) < WINDOW_CM]
        if len(near):
            tangent = place_at(curve, place + 0.5) - place_at(curve, place - 0.5)
            tangent /= np.linalg.norm(tangent)
            middle = place_at(curve, place)
            width = _width(means[near] - middle, covariances[near], opacities[near], tangent, opaque)
            radii[number] = 0.5 * width
    known = np.isfinite(radii)
    if not known.any():
        return np.full(len(curve), np.nan)
    # A neighbour's leaf or boll widens single places.
    calm = np.array([np.nanmedian(radii[max(0, i - 2) : i + 3]) if known[i] else np.nan for i in range(len(radii))])
    along: Float64 = np.interp(lengths, places[known], calm[known])
    return along


def _width(means: Float64, covariances: Float64, opacities: NDArray[Any], tangent: Float64, opaque: float) -> float:
    """Median over the sides of the width, cm, of the opaque run nearest to the middle."""
    first = np.cross(tangent, np.eye(3)[int(np.argmin(np.abs(tangent)))])
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(tangent, first), tangent])
    flat = means @ frame.T
    spread = frame @ covariances @ frame.T
    # The least distance of a Gaussian along a ray is that of its middle from the ray.
    d, y = spread[:, 2, 2] + 1e-8, -flat[:, 2]
    shown = opacities * np.exp(-0.5 * y * y / d) > FAINT
    flat, spread, opacities, d, y = flat[shown], spread[shown], opacities[shown], d[shown], y[shown]
    angles = np.pi * np.arange(SIDES) / SIDES
    sides = np.column_stack([np.cos(angles), np.sin(angles)])
    a = ((sides @ spread[:, :2, :2]) * sides).sum(axis=2).T[:, None] + 1e-8
    b = (sides @ spread[:, :2, 2].T)[:, None]
    rays = np.arange(-REACH_CM, REACH_CM + RAY_CM / 2, RAY_CM)
    x = rays[:, None] - (sides @ flat[:, :2].T)[:, None]
    distances = (d * x * x - 2 * b * x * y + a * y * y) / (a * d - b * b)
    beyond = 1 - np.exp(np.log1p(-opacities * np.exp(-0.5 * distances)).sum(axis=2)) - opaque
    widths = [width for own in beyond if (width := _nearest_run(rays, own)) is not None]
    width = float(np.median(widths)) if len(widths) >= SIDES / 2 else np.nan
    return width if LIKELY_RADIUS_CM[0] <= 0.5 * width <= LIKELY_RADIUS_CM[1] else np.nan


def _nearest_run(rays: Float64, beyond: Float64) -> float | None:
    """Length of the run of places with `beyond` >= 0 that is nearest to 0; None where it is far or has no end."""
    inside, outside = np.flatnonzero(beyond >= 0), np.flatnonzero(beyond < 0)
    if not len(inside):
        return None
    start = inside[np.argmin(np.abs(rays[inside]))]
    after = int(np.searchsorted(outside, start))
    if abs(rays[start]) > MIDDLE_CM or not 0 < after < len(outside):
        return None
    low, high = outside[after - 1] + 1, outside[after] - 1
    share_low = beyond[low] / (beyond[low] - beyond[low - 1])
    share_high = beyond[high] / (beyond[high] - beyond[high + 1])
    return float(rays[high] - rays[low] + RAY_CM * (share_low + share_high))
