# SPDX-License-Identifier: Apache-2.0
"""The plant and its bolls in one image, by the bolls' network alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.network_maps import Maps
from ..core.scene import Camera
from ..core.srgb import CLIPPED
from ..gaussians.rasterizer import Window
from ..masks.bolls import BollNetwork
from ..masks.group_votes import group_votes

SIDES: Final = ("top", "bottom", "left", "right")
"""Sides of an image."""
PLANT: Final = 0.5
"""Probability from which a pixel is lint, bur, wood or leaf."""
BRIDGED: Final = 0.02
"""Gap in a twig that the network misses, in widths of the image, over which parts still join."""
CUT: Final = 0.01
"""Share of a side that a plant must cross to be cut by it."""


@dataclass(frozen=True)
class Sight:
    """The plant and its bolls in one image."""

    camera: Camera
    ids: NDArray[np.uint16]
    """(H, W) bolls from 1 on."""
    middles_px: NDArray[np.float64]
    """(B, 2) x, y of the middle of boll b + 1, seen or not."""
    diameters_px: NDArray[np.float64]
    """(B,)"""
    lint_luminance: float
    """0..1; NaN without lint."""
    burnt_share: float
    """Burnt-out share of the lint; NaN without lint."""
    plant: NDArray[np.int32]
    """(h, w) numbers of the connected parts that look like a plant; 0 = none."""

    def parts_of(self, places_px: NDArray[Any]) -> set[int]:
        """The parts of the plant on which, or next to which, (N, 2) places lie."""
        scale = self.plant.shape[1] / self.camera.width
        x, y = np.floor(np.asarray(places_px).reshape(-1, 2) * scale).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < self.plant.shape[1]) & (y < self.plant.shape[0])
        return set(self.plant[y[inside], x[inside]].tolist()) - {0}

    def cut_sides(self, parts: set[int]) -> tuple[str, ...]:
        """Sides of the image that these parts cross."""
        plant = np.isin(self.plant, list(parts))
        edges = (plant[0], plant[-1], plant[:, 0], plant[:, -1])
        return tuple(side for side, edge in zip(SIDES, edges, strict=True) if edge.mean() > CUT)


def detect_in_view(
    image: NDArray[np.uint8], camera: Camera, network: BollNetwork, window: Window | None = None
) -> Sight:
    """The network's detections in an (H, W, 3) sRGB image, or in the window of it that shows the plant."""
    maps = network.maps(image, window=window)
    ids, _ = group_votes(maps)
    small = cv2.resize(ids, maps.lint.shape[::-1], interpolation=cv2.INTER_NEAREST)
    shown = np.unique(small[small > 0])
    ids = np.where(np.isin(ids, shown), np.searchsorted(shown, ids) + 1, 0).astype(np.uint16)
    bolls = [small == boll for boll in shown]
    lint = image[ids > 0].mean(axis=1)
    return Sight(
        camera,
        ids,
        middles_px=np.array([np.median(maps.votes[:, own], axis=1) for own in bolls], np.float64).reshape(-1, 2),
        diameters_px=np.array([np.median(maps.diameters[own]) for own in bolls], np.float64),
        lint_luminance=float(lint.mean()) / 255 if len(lint) else np.nan,
        burnt_share=float((lint >= CLIPPED).mean()) if len(lint) else np.nan,
        plant=_parts(maps),
    )


def _parts(maps: Maps) -> NDArray[np.int32]:
    plant = (maps.probabilities[1:].sum(axis=0) > PLANT).astype(np.uint8)
    side = 2 * round(0.5 * BRIDGED * plant.shape[1]) + 1
    bridged = cv2.morphologyEx(plant, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    return np.asarray(cv2.connectedComponents(bridged)[1], np.int32)
