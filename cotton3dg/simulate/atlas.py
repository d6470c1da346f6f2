# SPDX-License-Identifier: Apache-2.0
"""All textures of a room in one picture, each with its chain of prefiltered sizes (mip levels)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

BORDER: Final = 2
"""Texels repeated around each texture, so that interpolation never reads a neighbour's."""
FULL: Final = 65535.0 / 4.0
"""Stored value of linear light 1; brighter highlights fit up to 4."""


@dataclass(frozen=True)
class Atlas:
    """Textures and their mip levels; level l has half the size of level l - 1."""

    texels: NDArray[np.uint16]
    """(H, W, 3) linear light times `FULL`."""
    places: NDArray[np.float32]
    """(T, L, 4) x, y, width, height of texture t at level l; levels beyond the last repeat it."""
    last_levels: NDArray[np.float32]
    """(T,)"""

    def sample(
        self, textures: NDArray[np.intp], s: NDArray[np.float32], t: NDArray[np.float32], levels: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """(N, 3) linear light at (s, t) in 0..1 of each texture, interpolated in space and between levels."""
        levels = np.clip(levels, 0, self.last_levels[textures])
        whole = levels.astype(np.intp)
        share = (levels - whole)[:, None]
        fine = self._bilinear(self.places[textures, whole], s, t)
        coarse = self._bilinear(self.places[textures, whole + 1], s, t)
        return (fine + share * (coarse - fine)) * np.float32(1 / FULL)

    def _bilinear(
        self, places: NDArray[np.float32], s: NDArray[np.float32], t: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        # cv2.remap takes pictures whose sides are at most 32767.
        n, columns = len(s), 1024
        rows = -(-n // columns)
        x, y = np.zeros((2, rows * columns), np.float32)
        x[:n] = places[:, 0] + s * places[:, 2] - 0.5
        y[:n] = places[:, 1] + t * places[:, 3] - 0.5
        sampled = cv2.remap(self.texels, x.reshape(rows, columns), y.reshape(rows, columns), cv2.INTER_LINEAR)
        colours: NDArray[np.float32] = sampled.reshape(-1, 3)[:n].astype(np.float32)
        return colours


def pack(images: Sequence[NDArray[np.float32]], width: int = 4096) -> Atlas:
    """Atlas of (H, W, 3) linear images, packed on shelves in order of height."""
    tiles: list[tuple[int, int, NDArray[np.uint16]]] = []
    last_levels = np.zeros(len(images), np.float32)
    for texture, image in enumerate(images):
        level = image
        for depth in range(12):
            stored = (level * FULL + 0.5).clip(0, 65535).astype(np.uint16)
            tiles.append((texture, depth, np.pad(stored, ((BORDER, BORDER), (BORDER, BORDER), (0, 0)), mode="edge")))
            last_levels[texture] = depth
            if min(level.shape[:2]) < 4:
                break
            size = (max(1, level.shape[1] // 2), max(1, level.shape[0] // 2))
            level = cv2.resize(level, size, interpolation=cv2.INTER_AREA)

    width = max(width, *(tile.shape[1] for _, _, tile in tiles))
    places = np.zeros((len(images), 14, 4), np.float32)
    x = y = shelf = 0
    spots = []
    for texture, depth, tile in sorted(tiles, key=lambda entry: -entry[2].shape[0]):
        if x + tile.shape[1] > width:
            x, y, shelf = 0, y + shelf, 0
        shelf = max(shelf, tile.shape[0])
        spots.append((x, y, tile))
        size = (tile.shape[1] - 2 * BORDER, tile.shape[0] - 2 * BORDER)
        places[texture, depth] = x + BORDER, y + BORDER, *size
        x += tile.shape[1]
    texels = np.zeros((y + shelf, width, 3), np.uint16)
    for x, y, tile in spots:
        texels[y : y + tile.shape[0], x : x + tile.shape[1]] = tile
    for texture, last in enumerate(last_levels.astype(int)):
        places[texture, last + 1 :] = places[texture, last]
    return Atlas(texels, places, last_levels)
