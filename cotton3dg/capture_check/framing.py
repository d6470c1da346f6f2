# SPDX-License-Identifier: Apache-2.0
"""Whether plant and table are whole in the images, and from which sides they were filmed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float64
from ..geometry.camera_orbit import Orbit, azimuths
from .first_count import FoundBoll
from .view_detections import SIDES, Sight


def find_cut_sides(bolls: Sequence[FoundBoll], cameras: Sequence[Camera]) -> dict[str, tuple[str, ...]]:
    """Image -> sides that cut one of the bolls; images that show all bolls whole are left out."""
    cut: dict[str, tuple[str, ...]] = {}
    if not bolls:
        return cut
    centres = np.stack([boll.centre for boll in bolls])
    radii = np.array([0.5 * boll.diameter_su for boll in bolls])
    for camera in cameras:
        pixels, depths = camera.project(centres)
        ahead = depths > 0
        reach_px = camera.fx * radii[ahead] / depths[ahead]
        (x, y) = pixels[ahead].T
        over = (y < reach_px, y > camera.height - reach_px, x < reach_px, x > camera.width - reach_px)
        sides = tuple(side for side, which in zip(SIDES, over, strict=True) if which.any())
        if sides:
            cut[camera.name] = sides
    return cut


def find_cut_plants(bolls: Sequence[FoundBoll], sights: Sequence[Sight]) -> dict[str, tuple[str, ...]]:
    """As `find_cut_sides`, but by the pixels that look like the plant: it also finds what no image shows whole."""
    centres = np.array([boll.centre for boll in bolls]).reshape(-1, 3)
    cut = {}
    for sight in sights:
        pixels, depths = sight.camera.project(centres)
        sides = sight.cut_sides(sight.parts_of(pixels[depths > 0]))
        if sides:
            cut[sight.camera.name] = sides
    return cut


def corners_in_view(corners: NDArray[Any], cameras: Sequence[Camera]) -> Float64:
    """(4,) share of the images that show each of (4, 3) corners."""
    seen = []
    for camera in cameras:
        pixels, depths = camera.project(corners)
        seen.append((depths > 0) & ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=1))
    return np.asarray(np.mean(seen, axis=0))


def find_gaps(cameras: Sequence[Camera], orbit: Orbit, least_deg: float) -> list[tuple[float, float]]:
    """Parts of the turn without a view, (from, to) in degrees from the first image on, in the direction of the walk.

    The walk never covered a part that reaches 360. Only parts of at least `least_deg` are given, the widest first.
    """
    angles = np.degrees(azimuths(cameras, orbit))
    steps = np.mod(np.diff(angles) + 180, 360) - 180
    if steps.sum() < 0:
        angles = np.mod(-angles, 360)
    order = np.sort(angles)
    ends = np.append(order[1:], 360.0)
    gaps = [(float(a), float(b)) for a, b in zip(order, ends, strict=True) if b - a >= least_deg]
    return sorted(gaps, key=lambda gap: gap[0] - gap[1])
