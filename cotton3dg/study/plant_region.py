# SPDX-License-Identifier: Apache-2.0
"""The pixels of a photo that show the plant, independent of the judged model: the same for all settings of a study."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..gaussians.plant_windows import find_plant_windows
from ..gaussians.rasterizer import Window
from ..gaussians.views import View, hold_out
from ..masks.bolls import open_bolls

PLANT: Final = 0.25
"""Least probability of lint, bur, wood or leaf for a pixel of the plant; the network is never sure of thin twigs."""

EDGE_SHARE: Final = 0.003
"""Margin that widens a region at each side beyond the network's pixels, relative to the image's longer side: models
differ most at the plant's edge."""


class PlantRegions:
    """Regions of photos, each computed once."""

    def __init__(self) -> None:
        self._known: dict[bytes, NDArray[np.bool_]] = {}

    def of_held_out(self, views: Sequence[View], every: int, points: NDArray[np.float64]) -> list[NDArray[np.bool_]]:
        """Regions, (H, W) each, of the photos that `hold_out` holds out.

        Args:
            points: (N, 3) su, from structure from motion; those above the table give the plant's window.
        """
        windows = find_plant_windows(points, [view.camera for view in views])
        _, held_out = hold_out(list(zip(views, windows, strict=True)), every)
        return [self._of(*each) for each in held_out]

    def _of(self, view: View, window: Window | None) -> NDArray[np.bool_]:
        key = hashlib.sha256(view.image.tobytes()).digest() + repr(window).encode()
        if key not in self._known:
            self._known[key] = find_plant_region(view.image, window)
        return self._known[key]


def find_plant_region(image: NDArray[np.uint8], window: Window | None) -> NDArray[np.bool_]:
    """(H, W) pixels that the bolls' network takes for parts of a plant, within the window.

    Args:
        image: (H, W, 3) sRGB.
        window: left, top, width, height, px; None = the whole image.
    """
    height, width = image.shape[:2]
    left, top, across, down = window or (0, 0, width, height)
    shown = slice(top, top + down), slice(left, left + across)
    other = cv2.resize(open_bolls().maps(image).probabilities[0], (width, height))
    region = np.zeros((height, width), np.uint8)
    region[shown] = other[shown] < 1 - PLANT
    side_px = 2 * max(1, round(EDGE_SHARE * max(height, width))) + 1
    grown: NDArray[np.bool_] = cv2.dilate(region, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side_px, side_px))) > 0
    return grown


def resized(region: NDArray[np.bool_], like: View) -> NDArray[np.bool_]:
    """The region at the size of a view: the pixels that it covers by half."""
    size = like.camera.width, like.camera.height
    covered: NDArray[np.bool_] = cv2.resize(region.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5
    return covered
