# SPDX-License-Identifier: Apache-2.0
"""Places on level planes where photos from all sides show the same colour: there the plane is a surface.

They replace the Gaussians of a model, which show how far the table reaches where structure from motion has too few
points. The method is plane sweeping (Collins 1996) over the few planes that the points themselves suggest: the planes
on which they lie, and planes parallel to the floor, as the few things on a bare table may give its height only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float64
from ..geometry.camera_orbit import Orbit
from ..geometry.planes import CELL, REACH, TOLERANCE, floor_normal, level_planes, parallel_planes

SIDE_PX: Final = 480
"""Longer side of the photos that are compared."""
LEAST_VIEWS: Final = 5


def find_agreeing_places(
    tracks: NDArray[Any],
    orbit: Orbit,
    cameras: Sequence[Camera],
    photos: Sequence[NDArray[np.uint8]],
    tolerance: float,
) -> Float64:
    """(N, 3) su, on a grid of each level plane.

    Args:
        tracks: (T, 3) su, triangulated points.
        photos: (H, W, 3) of the cameras, from all sides.
        tolerance: grey levels, largest median deviation of the views from their median colour.
    """
    tracks = np.asarray(tracks, np.float64)
    small = [_shrink(photo) for photo in photos]
    planes = level_planes(tracks, orbit)
    up = floor_normal(tracks, orbit)
    if up is not None:
        planes += [plane for plane in parallel_planes(tracks, orbit, up) if _is_new(plane, planes, orbit)]
    places = [_agreeing(_grid(plane, orbit), cameras, small, tolerance) for plane in planes]
    return np.concatenate([*places, np.zeros((0, 3))])


def _is_new(plane: Float64, planes: Sequence[Float64], orbit: Orbit) -> bool:
    """Whether a plane differs from all others, somewhere on a table, by more than the tolerance of a plane."""
    grid = _grid(plane, orbit)
    table = grid[np.linalg.norm(grid - grid.mean(axis=0), axis=1) < REACH * orbit.radius]
    return all(np.abs(table @ other[:3] + other[3]).max() > TOLERANCE * orbit.radius for other in planes)


def _shrink(photo: NDArray[np.uint8]) -> NDArray[np.float32]:
    """The photo, small and a little blurred, so that places need not fit to the pixel."""
    factor = min(1.0, SIDE_PX / max(photo.shape[:2]))
    small = cv2.resize(photo, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    blurred: NDArray[np.float32] = cv2.GaussianBlur(small, (0, 0), 1.5).astype(np.float32)
    return blurred


def _grid(plane: Float64, orbit: Orbit) -> Float64:
    """(G, 3) su, a grid on a plane that reaches as far as the cameras."""
    up = plane[:3]
    x = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    x /= np.linalg.norm(x)
    steps = np.arange(-1.0, 1.0, CELL) + CELL / 2
    u, v = (part.ravel() for part in np.meshgrid(steps, steps))
    inside = np.hypot(u, v) < 1.0
    foot = orbit.centre - (up @ orbit.centre + plane[3]) * up
    flat = np.outer(u[inside], x) + np.outer(v[inside], np.cross(up, x))
    return np.asarray(foot + orbit.radius * flat)


def _agreeing(
    points: Float64, cameras: Sequence[Camera], photos: Sequence[NDArray[np.float32]], tolerance: float
) -> Float64:
    colours = np.full((len(cameras), len(points), 3), np.nan, np.float32)
    for seen, camera, photo in zip(colours, cameras, photos, strict=True):
        pixels, depths = camera.project(points)
        x, y = (pixels * (photo.shape[1] / camera.width) - 0.5).T
        inside = (depths > 0) & (x >= 0) & (y >= 0) & (x <= photo.shape[1] - 1) & (y <= photo.shape[0] - 1)
        at = [np.ascontiguousarray(part[inside, None], np.float32) for part in (x, y)]
        seen[inside] = cv2.remap(photo, at[0], at[1], cv2.INTER_LINEAR)[:, 0]
    enough = np.isfinite(colours[..., 0]).sum(axis=0) >= LEAST_VIEWS
    points, colours = points[enough], colours[:, enough]
    away = np.abs(colours - np.nanmedian(colours, axis=0)).max(axis=2)
    agreeing: Float64 = points[np.nanmedian(away, axis=0) < tolerance]
    return agreeing
