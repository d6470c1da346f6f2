# SPDX-License-Identifier: Apache-2.0
"""What photos show along thin lines, once more in plain numpy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cotton3dg.core.scene import Camera


def line_evidence(
    pictures: Sequence[NDArray[np.uint8]],
    cameras: Sequence[Camera],
    places: NDArray,
    directions: NDArray,
    colours: NDArray,
    aside_px: Sequence[float],
    noise: float,
    colour_share: float,
) -> tuple[NDArray, NDArray]:
    """(V, N) each: sums over colours of (I - B)(W - B) and of (W - B)², weighted by their variance.

    Args:
        pictures: (H, W, 4) each, colour and what is hidden.
    """
    above, below = np.zeros((2, len(pictures), len(places)))
    offsets = np.array([0.0, *aside_px, *(-aside for aside in aside_px)])
    for view, (picture, camera) in enumerate(zip(pictures, cameras, strict=True)):
        pixels, depths = camera.project(places)
        further, _ = camera.project(places + 1e-6 * directions)
        tangents = further - pixels
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        across = np.column_stack([-tangents[:, 1], tangents[:, 0]])
        seen = bilinear(picture, pixels - 0.5 + offsets[:, None, None] * across)
        clear = (depths > 0) & np.isfinite(seen).all(axis=(0, 2))
        shown, aside = seen[0][clear], seen[1:, clear]
        behind = aside.mean(axis=0)
        texture = np.abs(aside - behind).mean(axis=(0, 2))
        contrast = colours[view] - behind
        power = (contrast**2).sum(axis=1)
        variance = noise**2 + texture**2 + colour_share**2 * power / 3
        above[view, clear] = ((shown - behind) * contrast).sum(axis=1) / variance
        below[view, clear] = power / variance
    return above, below


def bilinear(picture: NDArray[np.uint8], pixels: NDArray) -> NDArray:
    """(..., 3) colours between the centres of pixels, which are at whole numbers (x, y); NaN outside and where one of
    the four is hidden."""
    height, width = picture.shape[:2]
    shown = np.where(picture[..., 3:] > 0, np.nan, picture[..., :3].astype(float))
    result = np.full((*pixels.shape[:-1], 3), np.nan)
    inside = (pixels >= 0).all(axis=-1) & (pixels <= (width - 1, height - 1)).all(axis=-1)
    x, y = pixels[inside].T
    left, top = x.astype(int), y.astype(int)
    right, low = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    right_share, low_share = (x - left)[:, None], (y - top)[:, None]
    upper = (1 - right_share) * shown[top, left] + right_share * shown[top, right]
    lower = (1 - right_share) * shown[low, left] + right_share * shown[low, right]
    result[inside] = (1 - low_share) * upper + low_share * lower
    return result
