# SPDX-License-Identifier: Apache-2.0
"""The window of each photo that shows the plant. Most fine steps of a training, and the bolls' network, use only it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ..core.scene import Camera, Float64
from ..geometry.camera_orbit import fit_orbit
from ..geometry.planes import TOLERANCE, table_plane
from .rasterizer import Window

REACH: Final = 0.6
"""Distance from the orbit's axis, relative to the orbit's radius, beyond which points belong to the room: half of a
table's long side."""

STRAY_SHARE: Final = 0.01
"""Share of the points at each end of the plant, along each axis, that count as strays."""

MARGIN: Final = 0.12
"""Margin of a window around the plant's points, relative to its longer side, because points end before twigs do. (It
cuts no mask of 296 plants, and 0.4 % of one that the frame cuts.)"""

SEEN_MARGIN: Final = 0.2
"""The same margin for the bolls' network, which understands an edge by its surroundings."""

LEAST_POINTS: Final = 100
"""Least number of points above the table from which the plant's ends are found."""

LARGEST_SHARE: Final = 0.8
"""Largest share of the image for a window. A larger window saves less than its borders cost."""

GRID_PX: Final = 16
"""Windows begin and end at tiles of the core."""


def find_plant_windows(points: Float64, cameras: Sequence[Camera], margin: float = MARGIN) -> list[Window | None]:
    """The part of each image that shows the plant; None where that is most of the image, or where it is unknown.

    Args:
        points: (N, 3) su, of structure from motion.
        cameras: of the images, from all around the plant.
        margin: margin of a window around the plant's points, relative to its longer side.
    """
    plant = find_plant_points(np.asarray(points, np.float64), cameras)
    if len(plant) < LEAST_POINTS:
        return [None] * len(cameras)
    return [_window(camera, plant, margin) for camera in cameras]


def find_plant_points(points: Float64, cameras: Sequence[Camera]) -> Float64:
    """(M, 3) su, those of the (N, 3) points that stand on the table: above the highest large level surface and near the
    axis of the cameras' orbit, strays left out. Empty without a table."""
    orbit, points = fit_orbit(cameras), points[np.isfinite(points).all(axis=1)]
    table = table_plane(points, orbit)
    if table is None:
        return np.zeros((0, 3))
    above = points @ table[:3] + table[3] > 3 * TOLERANCE * orbit.radius
    outward = np.linalg.norm(np.cross(points - orbit.centre, orbit.axis), axis=1)
    plant: Float64 = points[above & (outward < REACH * orbit.radius)]
    if not len(plant):
        return plant
    low, high = np.quantile(plant, [STRAY_SHARE, 1 - STRAY_SHARE], axis=0)
    kept: Float64 = plant[((plant >= low) & (plant <= high)).all(axis=1)]
    return kept


def _window(camera: Camera, plant: Float64, margin: float) -> Window | None:
    pixels, depths = camera.project(plant)
    if not (depths > 0).all():
        return None
    margin_px = margin * np.ptp(pixels, axis=0).max()
    size = np.array([camera.width, camera.height])
    low = np.clip(np.floor((pixels.min(axis=0) - margin_px) / GRID_PX) * GRID_PX, 0, size).astype(int)
    high = np.clip(np.ceil((pixels.max(axis=0) + margin_px) / GRID_PX) * GRID_PX, 0, size).astype(int)
    width, height = (int(length) for length in high - low)
    share = width * height / (camera.width * camera.height)
    return (int(low[0]), int(low[1]), width, height) if 0 < share <= LARGEST_SHARE else None
