# SPDX-License-Identifier: Apache-2.0
"""Pictures of a training of probabilities: the map of a view over the steps, and the lint alone (paper on binary
segmentation, Fig. 3 and 4)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float32, Gaussians
from ..gaussians.metrics import to_uint8
from ..gaussians.rasterizer import render, render_values

PICTURED_STEPS: Final = (0, 250, 500, 1000, 2000, 3000, 5000, 7000, 10_000, 12_000)
ACROSS: Final = 4
"""Maps side by side."""
WIDTH_PX: Final = 480
"""Width of one map."""


def draw_training(gaussians: Gaussians, camera: Camera, reached: Mapping[int, Float32]) -> NDArray[np.uint8]:
    """(H, W, 3) rendered probabilities of a view after so many steps, dark blue = 0 to yellow = 1.

    Args:
        reached: steps -> (N,) probabilities.
    """
    import cv2

    small = camera.resized(WIDTH_PX, round(WIDTH_PX * camera.height / camera.width))
    maps = render_values(gaussians, small, np.stack(list(reached.values()), axis=1)).image
    tiles = []
    for channel, steps in enumerate(reached):
        tile = cv2.applyColorMap(to_uint8(maps[..., channel]), cv2.COLORMAP_VIRIDIS)[..., ::-1].copy()
        cv2.putText(tile, f"{steps} steps", (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255,) * 3, 1, cv2.LINE_AA)
        tiles.append(tile)
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % min(ACROSS, len(tiles)))
    rows = [np.concatenate(tiles[k : k + ACROSS], axis=1) for k in range(0, len(tiles), ACROSS)]
    return np.concatenate(rows)


def draw_lint(lint: Gaussians, camera: Camera) -> NDArray[np.uint8]:
    """(H, W, 3) the Gaussians of lint alone, in their colours on black."""
    return to_uint8(render(lint, camera).image)
