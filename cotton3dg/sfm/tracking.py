# SPDX-License-Identifier: Apache-2.0
"""Where the features of one image lie in the next: Lucas and Kanade's tracker over a pyramid (Bouguet 2000), by OpenCV.

Descriptors need corners as sharp as those of the other image. A tracker only needs images that look alike, so it
follows a walk through blur, and over surfaces with few and weak corners.
"""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

WINDOW_PX: Final = 31
PYRAMID_LEVELS: Final = 4
"""Side of the square that is compared, and halvings of the image. With these the tracker follows some 150 px."""
LOOK_SIDE_PX: Final = 960
"""Longer side of the images that are compared."""
THERE_AND_BACK_PX: Final = 1.0
"""Largest distance from its start of a place that was tracked on and back again, px of the compared images."""
LEAST_TEXTURE: Final = 1e-4
"""Smaller eigenvalue of the gradients in the square below which there is no texture to follow."""


def follow(
    first: NDArray[np.uint8], second: NDArray[np.uint8], places_px: NDArray[np.float32]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Places of the first image found in the second one.

    Args:
        first, second: (H, W) grey, of one size.
        places_px: (N, 2) x, y; the corner of the first pixel is (0, 0).
    Returns:
        Rows (M,) of the places that were found, and where they are in the second image, (M, 2) px.
    """
    if not len(places_px):
        return np.zeros(0, np.int64), np.zeros((0, 2), np.float32)
    height, width = first.shape
    scale = min(1.0, LOOK_SIDE_PX / max(width, height))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    factor = np.array(size, np.float32) / np.array([width, height], np.float32)
    small, other = (cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (first, second))
    start = (places_px * factor - 0.5).astype(np.float32)[:, None]

    def tracked(one: NDArray[Any], two: NDArray[Any], places: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        found, seen, _ = cv2.calcOpticalFlowPyrLK(
            one, two, places, places.copy(), winSize=(WINDOW_PX, WINDOW_PX), maxLevel=PYRAMID_LEVELS,
            minEigThreshold=LEAST_TEXTURE,
        )  # fmt: skip
        return found, seen[:, 0] > 0

    there, seen = tracked(small, other, start)
    back, seen_back = tracked(other, small, there)
    off = np.linalg.norm((back - start)[:, 0], axis=1)
    found = there[:, 0] + 0.5
    inside = ((found >= 0) & (found < size)).all(axis=1)
    rows = np.flatnonzero(seen & seen_back & (off < THERE_AND_BACK_PX) & inside)
    return rows, (found[rows] / factor).astype(np.float32)
