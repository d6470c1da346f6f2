# SPDX-License-Identifier: Apache-2.0
"""How fast the picture moves at the triangulated points; motion blur and a rolling shutter depend on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...core.scene import Camera, Float64

Int64 = NDArray[np.int64]

FARTHEST: Final = 3.0
"""An image has no known speed if its neighbours are farther away in time than this many times the usual interval."""


@dataclass(frozen=True)
class Tracks:
    """K places at which V images of a walk show P triangulated points."""

    cameras: Sequence[Camera]
    """V, in order of time."""
    times: Float64
    """(V,) ascending, frames of the video."""
    views: Int64
    """(K,) image of each place."""
    points: Int64
    """(K,) point of each place."""
    places_px: Float64
    """(K, 2)"""
    xyz: Float64
    """(P, 3) su."""

    def __getitem__(self, rows: NDArray[Any]) -> Tracks:
        """The places at `rows` (indices or a mask)."""
        return Tracks(self.cameras, self.times, self.views[rows], self.points[rows], self.places_px[rows], self.xyz)


def find_longest_tracks(
    cameras: Sequence[Camera],
    times: Float64,
    seen: Mapping[str, tuple[Float64, Int64]],
    positions: tuple[Int64, Float64],
    most: int,
) -> Tracks:
    """The tracks of the `most` points that the most images show, three images at least.

    Args:
        cameras: V, in order of time.
        times: (V,) ascending, frames of the video.
        seen: name of a camera -> where it shows points (K, 2) px and the points' ids (K,).
        positions: ids (P,), ascending, and places (P, 3) su of all points.
    """
    ids, xyz = positions
    views = np.concatenate([np.full(len(seen[camera.name][1]), i) for i, camera in enumerate(cameras)])
    numbers = np.concatenate([seen[camera.name][1] for camera in cameras])
    places = np.concatenate([seen[camera.name][0] for camera in cameras])
    known = np.isin(numbers, ids)
    views, places, rows = views[known], places[known], np.searchsorted(ids, numbers[known])
    counts = np.bincount(rows, minlength=len(ids))
    chosen = np.zeros(len(ids), bool)
    chosen[np.argsort(-counts, kind="stable")[:most]] = True
    chosen &= counts >= 3
    keep = chosen[rows]
    return Tracks(cameras, times, views[keep], (np.cumsum(chosen) - 1)[rows[keep]], places[keep], xyz[chosen])


def measure_velocities(tracks: Tracks) -> Float64:
    """(K, 2) px a frame of the video: how the camera's way from the image before to the image after moves each point.

    NaN where these images are too far apart in time. Shaking in between does not show.
    """
    last = len(tracks.cameras) - 1
    before, after = np.maximum(tracks.views - 1, 0), np.minimum(tracks.views + 1, last)
    apart = tracks.times[after] - tracks.times[before]
    usual = np.median(np.diff(tracks.times))
    apart = np.where((apart > 0) & (apart <= FARTHEST * usual * (after - before)), apart, np.nan)
    return (_project(tracks, after) - _project(tracks, before)) / apart[:, None]


def in_cameras(tracks: Tracks, views: Int64) -> Float64:
    """(K, 3) su: the point of each place in the axes of the camera `views` (K,)."""
    poses = np.array([camera.cam_from_scene for camera in tracks.cameras])[views]
    in_camera: Float64 = np.einsum("kij,kj->ki", poses[:, :, :3], tracks.xyz[tracks.points]) + poses[:, :, 3]
    return in_camera


def _project(tracks: Tracks, views: Int64) -> Float64:
    x, y, depth = in_cameras(tracks, views).T
    camera = tracks.cameras[0]
    depth = np.where(depth > 0, depth, np.nan)
    return np.column_stack([camera.fx * x / depth + camera.cx, camera.fy * y / depth + camera.cy])
