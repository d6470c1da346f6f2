# SPDX-License-Identifier: Apache-2.0
"""The opacity of the model at which wood ends.

A camera adds light, also in pixels that wood half covers, while the model mixes sRGB values. Half of dark wood and half
of a bright wall is nearer to the wall in sRGB than the mean of both, so where wood covers half of a pixel, training
leaves less than half of its opacity. If wood ended at an opacity of one half, stems before bright rooms would be too
thin by a third of a pixel (docs/notes/plant_map.md). This is not in the papers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Gaussians
from ..core.srgb import to_linear, to_srgb
from ..gaussians.rasterizer import render

VIEWS: Final = 12
LONGER_PX: Final = 320
HALF: Final = 0.5
LIKELY: Final = (0.25, 0.75)
"""Black before white, and white before black, with some room."""
LEAST_CONTRAST: Final = 0.002
"""Mean squared difference of wood and its background below which edges do not determine the opacity."""


def edge_opacity(wood: Gaussians, behind: Gaussians, cameras: Sequence[Camera]) -> float:
    """The opacity that training gives to wood that covers half of a pixel; a half without cameras.

    Args:
        wood: Gaussians of the plant that are not bolls. behind: all that are not the plant.
    """
    if not (len(wood) and len(behind) and len(cameras)):
        return HALF
    chosen = np.linspace(0, len(cameras) - 1, min(VIEWS, len(cameras))).astype(int)
    views = [_colours(wood, behind, cameras[number]) for number in chosen]
    return opacity_at_half(*(np.concatenate(side) for side in zip(*views, strict=True)))


def opacity_at_half(front: NDArray[Any], behind: NDArray[Any]) -> float:
    """For colours (N, 3) of both sides of an edge, sRGB in 0..1: least squares over all of b - c = a (b - f), with c
    the sRGB value of half of the light of each."""
    half = to_srgb((to_linear(front) + to_linear(behind)) / 2)
    contrast = behind - front
    power = float((contrast**2).sum())
    if power <= LEAST_CONTRAST * contrast.size:
        return HALF
    return float(np.clip(((behind - half) * contrast).sum() / power, *LIKELY))


def _colours(wood: Gaussians, behind: Gaussians, camera: Camera) -> tuple[NDArray[Any], ...]:
    """(N, 3) of wood and of its background, in the pixels that wood fills."""
    zoom = min(1.0, LONGER_PX / max(camera.width, camera.height))
    small = camera.resized(max(1, round(zoom * camera.width)), max(1, round(zoom * camera.height)))
    shown, room = render(wood, small), render(behind, small)
    covered, seen = 1 - shown.transmittance, 1 - room.transmittance
    at = (covered > 0.5) & (seen > 0.5)
    return tuple(
        np.clip(picture.image[at] / share[at][:, None], 0, 1) for picture, share in ((shown, covered), (room, seen))
    )
