# SPDX-License-Identifier: Apache-2.0
"""Large level planes around which the cameras walk: a table top, the floor.

All lengths below are relative to the radius R of the orbit, because nothing has a unit yet.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64
from .camera_orbit import Orbit

TOLERANCE: Final = 0.006
"""Distance from a plane that counts as on it, R: 8 mm at an orbit of 1.3 m."""
CELL: Final = 0.02
"""Cells in which covered area is counted, R."""
REACH: Final = 0.75
"""Distance from the orbit's axis to which a table reaches, R."""
ROOM: Final = 3.0
"""Distance from the orbit's axis within which the floor is searched, R."""
MOST_PARALLEL: Final = 6
LEAST_PARALLEL: Final = 15
"""Number of heights that are tried, and least number of points at one."""
MAX_TILT: Final = np.radians(25.0)
"""Between the table's normal and the orbit's axis: people raise and lower the phone while they walk."""
MIN_AREA: Final = 0.2
"""Area of a plane relative to the largest one; two clamp tubes cover a twentieth of the table."""
HYPOTHESES: Final = 10_000
STANDS_OUT: Final = 1.4
"""Points on a surface, relative to those in the layers right above and below it, each as thick. Of 348 table tops and
floors 334 have more (most ten times as many), of 38 slices through crowns none."""


def level_planes(points: Float64, orbit: Orbit, seed: int = 0, reach: float = REACH) -> list[Float64]:
    """Planes (4,) of the level surfaces inside the orbit, highest first: a x + b y + c z + d = height, (a, b, c) up.

    Points farther from the orbit's axis than `reach`, R, do not count.

    RANSAC (Fischler and Bolles 1981) over triples of points of similar height, seeded and of a fixed length. Points are
    thinned to one a cell first, so that area counts and not texture.
    """
    radius = orbit.radius
    height = (points - orbit.centre) @ orbit.axis
    outward = points - orbit.centre - height[:, None] * orbit.axis
    near = (np.linalg.norm(outward, axis=1) < reach * radius) & (np.abs(height) < 1.5 * radius)
    points = _thin(points[near], CELL / 2 * radius)
    planes: list[tuple[int, float, Float64]] = []
    rng = np.random.default_rng(seed)
    for _ in range(6):
        found = _largest_plane(points, orbit, rng)
        if found is None or (planes and found[1].sum() < MIN_AREA * max(planes)[0]):
            break
        plane, on_plane = found
        planes.append((int(on_plane.sum()), float(plane[:3] @ orbit.centre + plane[3]), plane))
        points = points[np.abs(points @ plane[:3] + plane[3]) > 3 * TOLERANCE * radius]
    # The higher a plane lies, the smaller its distance from the orbit's centre.
    return [plane for _, _, plane in sorted(planes, key=lambda item: (item[1], *item[2]))]


def table_plane(points: Float64, orbit: Orbit) -> Float64 | None:
    """(4,) the plane that a plant stands on: the highest of `level_planes` that is a surface, as dense crowns have
    level planes, too; where all is sparse, the one with most points. None without any."""
    planes = level_planes(points, orbit)
    outward = np.linalg.norm(np.cross(points - orbit.centre, orbit.axis), axis=1)
    near, tolerance = _thin(points[outward < REACH * orbit.radius], CELL / 2 * orbit.radius), TOLERANCE * orbit.radius
    most, fullest = -1, None
    for plane in planes:
        distance = np.abs(near @ plane[:3] + plane[3])
        on_plane = int((distance < tolerance).sum())
        if on_plane >= STANDS_OUT * int(((distance >= tolerance) & (distance < 3 * tolerance)).sum()):
            return plane
        if on_plane > most:
            most, fullest = on_plane, plane
    return fullest


def floor_normal(points: Float64, orbit: Orbit) -> Float64 | None:
    """(3,) up, of the lowest large level plane of the room; None without any."""
    planes = level_planes(points, orbit, reach=ROOM)
    return planes[-1][:3] if planes else None


def parallel_planes(points: Float64, orbit: Orbit, up: Float64) -> list[Float64]:
    """Planes (4,) with this normal at the heights where most points inside the orbit lie, fullest first.

    A few small things on a bare table lie at one height, but too close together to determine its tilt.
    """
    outward = points - orbit.centre - ((points - orbit.centre) @ orbit.axis)[:, None] * orbit.axis
    inside = points[np.linalg.norm(outward, axis=1) < REACH * orbit.radius]
    heights = np.sort(_thin(inside, CELL / 2 * orbit.radius) @ up)
    planes: list[Float64] = []
    while len(planes) < MOST_PARALLEL:
        counts = np.searchsorted(heights, heights + 2 * TOLERANCE * orbit.radius) - np.arange(len(heights))
        if not len(counts) or counts.max() < LEAST_PARALLEL:
            break
        first = int(np.argmax(counts))
        height = float(np.median(heights[first : first + counts[first]]))
        planes.append(np.append(up, -height))
        heights = heights[np.abs(heights - height) > 3 * TOLERANCE * orbit.radius]
    return planes


def _largest_plane(points: Float64, orbit: Orbit, rng: np.random.Generator) -> tuple[Float64, NDArray[np.bool_]] | None:
    """The level plane with most points and which points lie on it; ties go to the higher one."""
    if len(points) < 30:
        return None
    height = points @ orbit.axis
    order = np.argsort(height, kind="stable")
    ranked, height = points[order], height[order]
    low = np.searchsorted(height, height - 0.1 * orbit.radius)
    high = np.searchsorted(height, height + 0.1 * orbit.radius)
    i = rng.integers(len(ranked), size=HYPOTHESES)
    j, k = (low[i] + (rng.random(HYPOTHESES) * (high - low)[i]).astype(np.int64) for _ in range(2))
    normals = np.cross(ranked[j] - ranked[i], ranked[k] - ranked[i])
    lengths = np.linalg.norm(normals, axis=1)
    normals /= np.where(lengths > 0, lengths, 1)[:, None]
    normals *= np.where(normals @ orbit.axis < 0, -1, 1)[:, None]
    # Triples of close points determine the tilt badly.
    usable = (lengths > (0.15 * orbit.radius) ** 2) & (normals @ orbit.axis > np.cos(MAX_TILT))
    normals, offsets = normals[usable], -np.einsum("ij,ij->i", normals[usable], ranked[i[usable]])
    normals, offsets = normals[:2000], offsets[:2000]
    if not len(normals):
        return None
    tolerance = TOLERANCE * orbit.radius
    counts = np.concatenate(
        [
            (np.abs(normal @ points.T + offset[:, None]) < tolerance).sum(axis=1)
            for normal, offset in zip(np.array_split(normals, 20), np.array_split(offsets, 20), strict=True)
        ]
    )
    best = max(range(len(counts)), key=lambda n: (counts[n], -offsets[n]))
    plane = np.append(normals[best], offsets[best])
    for _ in range(5):
        on_plane = np.abs(points @ plane[:3] + plane[3]) < tolerance
        if on_plane.sum() < 30:
            return None
        plane = _fit_plane(points[on_plane], plane[:3])
    return plane, on_plane


def _fit_plane(points: Float64, up: Float64) -> Float64:
    """Least-squares plane (4,) of points, its normal on the side of `up`."""
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    normal = normal if normal @ up > 0 else -normal
    return np.append(normal, -normal @ middle)


def _thin(points: Float64, cell: float) -> Float64:
    """One point, the first, of each cube of size `cell`."""
    keys = np.floor(points / cell).astype(np.int64)
    return points[np.sort(np.unique(keys, axis=0, return_index=True)[1])]
