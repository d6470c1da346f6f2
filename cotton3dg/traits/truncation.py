# SPDX-License-Identifier: Apache-2.0
"""Whether the images show the plant whole, because parts that no image shows cannot be measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera

EDGE: Final = 0.01
"""Width of the frame's edge, relative to the longer side of the image. A part that reaches it is cut there, as the
model has nothing beyond."""
LEAST_SHARE: Final = 0.003
"""The frame cuts a plant if more than this share of it lies outside the image or on its edge."""
OFTEN: Final = 0.25
"""Share of cut images from which on it matters: bolls lose views, and parts that no image shows are unknown."""

NEARLY_ALWAYS: Final = 0.9
"""Share of cut images from which on the plant has no size, because too few images show where it ends."""


def find_cut(plant: NDArray[Any], cameras: Sequence[Camera]) -> list[str]:
    """Names of the images whose frame cuts a plant of (N, 3) points, su."""
    cut = []
    for camera in cameras:
        pixels, depths = camera.project(plant)
        edge = EDGE * max(camera.width, camera.height)
        inside = ((pixels >= edge) & (pixels <= (camera.width - edge, camera.height - edge))).all(axis=1)
        if len(plant) and np.mean(~inside | (depths <= 0)) > LEAST_SHARE:
            cut.append(camera.name)
    return cut


def find_cut_above(plant: NDArray[Any], cameras: Sequence[Camera]) -> list[str]:
    """Names of the images whose top or sides cut a plant of (N, 3) points, su; the bottom only cuts its foot."""
    cut = []
    for camera in cameras:
        pixels, depths = camera.project(plant)
        edge = EDGE * max(camera.width, camera.height)
        inside = (pixels[:, 1] >= edge) & (pixels[:, 0] >= edge) & (pixels[:, 0] <= camera.width - edge)
        if len(plant) and np.mean(~inside & (depths > 0)) > LEAST_SHARE:
            cut.append(camera.name)
    return cut


def check_truncation(plant: NDArray[Any], cameras: Sequence[Camera]) -> tuple[str, bool]:
    """A warning if the frame cuts a plant often, else an empty text; and whether nearly all images cut it, so that its
    size cannot be measured."""
    cut = find_cut(plant, cameras)
    if len(cut) <= OFTEN * len(cameras):
        return "", False
    lost = len(find_cut_above(plant, cameras)) >= NEARLY_ALWAYS * len(cameras)
    effect = "height and canopy cannot be measured" if lost else "height and canopy may be too small"
    return (
        f"the frame cuts the plant in {len(cut)} of {len(cameras)} images, e.g. {cut[0]}, so {effect}; step back until"
        " the whole plant is in view"
    ), lost
