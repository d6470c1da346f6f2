# SPDX-License-Identifier: Apache-2.0
"""A first count: bolls seen in single images are found in space where their lines of sight meet.

It does not need a model, so it takes seconds. It serves to judge a film, and is not the count that `run` gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float64
from ..geometry.camera_orbit import Orbit
from .view_detections import Sight

LEAST_ANGLE: Final = np.radians(8.0)
LARGEST_ANGLE: Final = np.radians(100.0)
"""Largest angle between two lines of sight that may suggest a boll."""
MEETING: Final = 0.35
"""Largest distance at which two lines of sight of one boll pass, in its diameters."""
ALIKE: Final = 1.6
"""Largest ratio of a boll's sizes by two sights."""
REACH: Final = 0.45
"""Largest distance, in diameters, of a sight from the place where the boll should appear."""
APART: Final = 0.75
"""Least distance of two bolls' middles, in diameters of the larger."""
LEAST_SIGHTS: Final = 3
SURE_SHARE: Final = 0.35
"""Share of the images in which a boll must have been seen to be sure."""


@dataclass(frozen=True)
class FoundBoll:
    """A boll in space."""

    centre: Float64
    """(3,) su."""
    diameter_su: float
    n_sights: int
    seen: tuple[tuple[int, int], ...] = ()
    """Number of each sight that shows it, from 0 on, and of the boll there, from 1 on."""


@dataclass(frozen=True)
class _Rays:
    """All sights of bolls as lines."""

    view: NDArray[np.int64]
    origin: Float64
    towards: Float64
    place_px: Float64
    diameter_px: Float64
    focal_px: Float64

    def depths(self, point: Float64, rows: NDArray[Any]) -> Float64:
        """How far along each line the point lies, su."""
        depths: Float64 = np.einsum("ij,ij->i", self.towards[rows], point - self.origin[rows])
        return depths


def find_bolls_in_space(sights: Sequence[Sight], orbit: Orbit) -> list[FoundBoll]:
    """Bolls that at least `LEAST_SIGHTS` images show, those that most images show first.

    Each two lines of sight that nearly meet within the orbit, at a place where both see the same size, suggest a boll.
    The boll that most images confirm is taken with its sights, and the search goes on with the remaining sights.
    """
    rays = _gather(sights)
    cameras = [sight.camera for sight in sights]
    points, sizes = _suggest(rays, orbit)
    near = _confirm(rays, cameras, points, sizes)
    bolls: list[FoundBoll] = []
    while True:
        support = _count_views(rays, near)
        if not len(support) or support.max() < LEAST_SIGHTS:
            return bolls
        best = int(np.argmax(support))
        rows = _one_a_view(rays, np.flatnonzero(near[best]), points[best], cameras)
        centre = _meet(rays, rows)
        diameter = float(np.median(rays.diameter_px[rows] * rays.depths(centre, rows) / rays.focal_px[rows]))
        own = rows - np.searchsorted(rays.view, rays.view[rows]) + 1
        seen = tuple(zip(rays.view[rows].tolist(), own.tolist(), strict=True))
        bolls.append(FoundBoll(centre, diameter, len(rows), seen))
        # Each sight is of one boll only, and no other boll's middle lies within a boll.
        near[:, rows] = False
        kept = np.linalg.norm(points - centre, axis=1) > APART * np.maximum(sizes, diameter)
        near, points, sizes = near[kept], points[kept], sizes[kept]


def find_sure(bolls: Sequence[FoundBoll], n_views: int) -> list[FoundBoll]:
    """The bolls that were seen in so many images that they are hardly chance."""
    return [boll for boll in bolls if boll.n_sights >= max(LEAST_SIGHTS, SURE_SHARE * n_views)]


def _gather(sights: Sequence[Sight]) -> _Rays:
    parts = []
    for number, sight in enumerate(sights):
        camera, n = sight.camera, len(sight.middles_px)
        flat = (sight.middles_px - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
        towards = np.column_stack([flat, np.ones(n)]) @ camera.rotation
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        origin = np.broadcast_to(camera.centre, (n, 3))
        parts.append((np.full(n, number), origin, towards, sight.middles_px, sight.diameters_px, np.full(n, camera.fx)))
    view, origin, towards, place, diameter, focal = (np.concatenate(part) for part in zip(*parts, strict=True))
    return _Rays(view.astype(np.int64), origin, towards, place, diameter, focal)


def _suggest(rays: _Rays, orbit: Orbit) -> tuple[Float64, Float64]:
    """(N, 3) places where two lines nearly meet, and the diameters (N,) there, su."""
    i, j = np.triu_indices(len(rays.view), 1)
    cosines = np.einsum("ij,ij->i", rays.towards[i], rays.towards[j])
    kept = (rays.view[i] != rays.view[j]) & (cosines < np.cos(LEAST_ANGLE)) & (cosines > np.cos(LARGEST_ANGLE))
    i, j, cosines = i[kept], j[kept], cosines[kept]
    between = rays.origin[j] - rays.origin[i]
    along_i, along_j = (np.einsum("ij,ij->i", rays.towards[rows], between) for rows in (i, j))
    sines = 1 - cosines**2
    depth_i, depth_j = (along_i - cosines * along_j) / sines, (cosines * along_i - along_j) / sines
    on_i = rays.origin[i] + depth_i[:, None] * rays.towards[i]
    on_j = rays.origin[j] + depth_j[:, None] * rays.towards[j]
    size_i, size_j = (
        rays.diameter_px[rows] * depth / rays.focal_px[rows] for rows, depth in ((i, depth_i), (j, depth_j))
    )
    points, sizes = 0.5 * (on_i + on_j), 0.5 * (size_i + size_j)
    with np.errstate(divide="ignore", invalid="ignore"):
        good = (depth_i > 0) & (depth_j > 0) & (np.abs(np.log(size_i / size_j)) < np.log(ALIKE))
    good &= np.linalg.norm(on_i - on_j, axis=1) < MEETING * sizes
    good &= np.linalg.norm(points - orbit.centre, axis=1) < orbit.distance
    return points[good], sizes[good]


def _confirm(rays: _Rays, cameras: Sequence[Camera], points: Float64, sizes: Float64) -> NDArray[np.bool_]:
    """(N, S) for each place, which sights lie where a boll at that place would appear, and are as large."""
    near = np.zeros((len(points), len(rays.view)), bool)
    for view, camera in enumerate(cameras):
        rows = np.flatnonzero(rays.view == view)
        pixels, depths = camera.project(points)
        expected_px = np.where(depths > 0, camera.fx * sizes / np.maximum(depths, 1e-12), 0.0)
        far_px = np.linalg.norm(pixels[:, None] - rays.place_px[rows], axis=2)
        ratio = np.abs(np.log(np.maximum(rays.diameter_px[rows], 1e-6) / np.maximum(expected_px, 1e-6)[:, None]))
        near[:, rows] = (far_px < REACH * expected_px[:, None]) & (ratio < np.log(ALIKE))
    return near


def _count_views(rays: _Rays, near: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(N,) images with at least one of the sights of each row; sights are in order of their images."""
    if not near.size:
        return np.zeros(len(near), np.int64)
    starts = np.unique(rays.view, return_index=True)[1]
    return np.asarray(np.logical_or.reduceat(near, starts, axis=1).sum(axis=1))


def _one_a_view(rays: _Rays, rows: NDArray[np.int64], point: Float64, cameras: Sequence[Camera]) -> NDArray[np.int64]:
    """For each image, its sight nearest to the point's projection."""
    far = np.array([np.linalg.norm(cameras[rays.view[r]].project(point[None])[0][0] - rays.place_px[r]) for r in rows])
    order = np.lexsort((rows, far))
    return rows[order[np.unique(rays.view[rows[order]], return_index=True)[1]]] if len(rows) else rows


def _meet(rays: _Rays, rows: NDArray[np.int64]) -> Float64:
    """(3,) su: the point closest to some lines."""
    across = np.eye(3) - rays.towards[rows][:, :, None] * rays.towards[rows][:, None, :]
    return np.asarray(np.linalg.solve(across.sum(axis=0), (across @ rays.origin[rows][:, :, None]).sum(axis=0))[:, 0])
