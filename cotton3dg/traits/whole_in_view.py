"""Whether the images show the plant whole: of what no image shows, nothing can be measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera

EDGE = 0.01
"""Width of the frame's edge, in longer sides of the image. What lies there ends there: the model has nothing beyond."""
LEAST_SHARE = 0.003
"""Share of a plant that lies outside of an image or on its edge when the frame cuts it."""
OFTEN = 0.25
"""Share of the images from which on it matters: bolls lose views, and beyond what all images cut nothing is known."""


def find_cut(plant: NDArray, cameras: Sequence[Camera]) -> list[str]:
    """Names of the images whose frame cuts a plant of (N, 3) points, su."""
    cut = []
    for camera in cameras:
        pixels, depths = camera.project(plant)
        edge = EDGE * max(camera.width, camera.height)
        inside = ((pixels >= edge) & (pixels <= (camera.width - edge, camera.height - edge))).all(axis=1)
        if len(plant) and np.mean(~inside | (depths <= 0)) > LEAST_SHARE:
            cut.append(camera.name)
    return cut


def doubt_whole(plant: NDArray, cameras: Sequence[Camera]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Flags and warnings about a plant that the frame cuts often."""
    cut = find_cut(plant, cameras)
    if len(cut) <= OFTEN * len(cameras):
        return (), ()
    return ("plant_cut",), (
        f"the frame cuts the plant in {len(cut)} of {len(cameras)} images, e.g. {cut[0]}, so height and canopy may be"
        " too small; step back until the whole plant is in view",
    )
