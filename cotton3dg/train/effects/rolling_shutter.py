# SPDX-License-Identifier: Apache-2.0
"""Finds whether the sensor read its rows one after another while the camera moved, and what the model still has of it.

A row read out later sees the scene from farther on. To first order a point at height y moves by its velocity times the
read-out time times y. The adjustment of cameras, points and lens to the images has absorbed a part of this motion. The
other part is still in the residuals. Its size follows from a comparison with the part of a known rolling shutter that
the adjustment would leave: one Gauss-Newton step of a bundle adjustment with one more unknown, the read-out time,
solved by eliminating all others (the score test of Rao, 1948).

Little of it remains in a walk around a plant: the point that the camera aims at stands still in the image, and small
turns and shifts of the cameras absorb the rest. docs/training.md says how little that moves the plant's points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ...core.scene import Float64
from .motion import Tracks, in_cameras, measure_velocities

VISIBLE_PX: Final = 0.5
"""Shift of the pixels, root mean square, below which a rolling shutter is smaller than the errors that structure from
motion has anyway."""
CERTAIN: Final = 3.0
"""... and the read-out time must exceed its own standard error by this factor."""
FEWEST_PLACES: Final = 500
HUBER: Final = 2.0
"""Residuals beyond this many times their median lose weight: wrong matches."""


@dataclass(frozen=True)
class RollingShutter:
    """The rolling shutter, estimated from the residuals of structure from motion."""

    read_out_frames: float
    """Read-out time from the first row to the last, frames of the video; negative from the last row to the first."""
    error_frames: float
    """Its standard error, from the scatter among points and among images."""
    shift_px: float
    """By how much it moves pixels, root mean square."""
    left_px: float
    """... and by how much after cameras and points have taken up what they can."""

    @property
    def found(self) -> bool:
        """Whether there is a rolling shutter that is large enough to be seen."""
        return self.shift_px > VISIBLE_PX and abs(self.read_out_frames) > CERTAIN * self.error_frames


def estimate_rolling_shutter(tracks: Tracks) -> RollingShutter:
    """Read-out time of the sensor, from rows; from columns where images are upright.

    Args:
        tracks: of images without lens distortion, all of one camera.
    Returns:
        Zero with an infinite error where too little is known.
    """
    speeds = measure_velocities(tracks)
    known = np.isfinite(speeds).all(axis=1) & (in_cameras(tracks, tracks.views)[:, 2] > 0)
    tracks, speeds = tracks[known], speeds[known]
    if len(speeds) < FEWEST_PLACES:
        return RollingShutter(0.0, np.inf, 0.0, 0.0)
    camera = tracks.cameras[0]
    axis = 1 if camera.width >= camera.height else 0
    lateness = tracks.places_px[:, axis] / (camera.width, camera.height)[axis] - 0.5
    shifts = speeds * lateness[:, None]

    residuals, by_camera, by_point = _linearise(tracks)
    lengths = np.linalg.norm(residuals, axis=1)
    weights = np.sqrt(1 / np.maximum(1, lengths / max(HUBER * float(np.median(lengths)), 1e-9)))
    rows = np.repeat(weights, 2)
    unexplained = _without(_rows_times(by_camera, rows), _rows_times(by_point, rows))
    shift, residual = (unexplained((values * weights[:, None]).ravel()) for values in (shifts, residuals))
    information = float(shift @ shift)
    if not information > 0:
        return RollingShutter(0.0, np.inf, 0.0, 0.0)
    read_out = float(shift @ residual) / information
    scores = shift * (residual - read_out * shift)
    # Wrong matches come by the point, unseen shaking by the image.
    sums = [np.bincount(np.repeat(group, 2), scores) for group in (tracks.points, tracks.views)]
    error = float(np.linalg.norm(np.concatenate(sums))) / information
    moved = np.sqrt((shifts**2).sum(axis=1).mean())
    left = np.sqrt(information / weights.dot(weights))
    return RollingShutter(read_out, error, float(abs(read_out) * moved), float(abs(read_out) * left))


def _linearise(tracks: Tracks) -> tuple[Float64, Any, Any]:
    """Residuals (K, 2) px of the projection, and their sparse derivatives (2K, ·) by cameras with lens, and by points.

    A camera has 6 unknowns (small turn and shift), the lens common to all 2 (focal length, radial distortion).
    """
    camera, (k, n_views) = tracks.cameras[0], (len(tracks.views), len(tracks.cameras))
    inside = in_cameras(tracks, tracks.views)
    rays, focal = inside[:, :2] / inside[:, 2:], np.array([camera.fx, camera.fy])
    residuals = tracks.places_px - (rays * focal + (camera.cx, camera.cy))
    by_inside = np.zeros((k, 2, 3))
    by_inside[:, (0, 1), (0, 1)] = focal / inside[:, 2:]
    by_inside[:, :, 2] = -rays * focal / inside[:, 2:]
    x, y, z = inside.T
    turned = np.zeros((k, 3, 3))
    turned[:, (0, 1, 2), (1, 2, 0)] = np.stack([z, x, y], axis=1)
    turned[:, (0, 1, 2), (2, 0, 1)] = -np.stack([y, z, x], axis=1)
    rotations = np.array([view.rotation for view in tracks.cameras])[tracks.views]
    by_lens = np.stack([rays * focal, rays * focal * (rays**2).sum(axis=1, keepdims=True)], axis=2)
    by_camera = np.concatenate([by_inside @ turned, by_inside, by_lens], axis=2)
    columns = np.concatenate(
        [6 * tracks.views[:, None] + np.arange(6), np.broadcast_to(6 * n_views + np.arange(2), (k, 2))], axis=1
    )
    points = 3 * tracks.points[:, None] + np.arange(3)
    return (
        residuals,
        _sparse(by_camera, columns, 6 * n_views + 2),
        _sparse(by_inside @ rotations, points, 3 * len(tracks.xyz)),
    )


def _sparse(blocks: Float64, columns: Any, n_columns: int) -> Any:
    """(2K, n_columns) from blocks (K, 2, C) and their columns (K, C)."""
    from scipy import sparse

    rows = np.broadcast_to(np.arange(2 * len(blocks)).reshape(-1, 2, 1), blocks.shape)
    places = (rows.ravel(), np.broadcast_to(columns[:, None], blocks.shape).ravel())
    return sparse.csr_matrix((blocks.ravel(), places), shape=(2 * len(blocks), n_columns))


def _rows_times(matrix: Any, factors: Float64) -> Any:
    from scipy import sparse

    return sparse.diags(factors) @ matrix


def _without(by_camera: Any, by_point: Any) -> Callable[[Float64], Float64]:
    """The part of a vector (2K,) that no change of cameras, lens and points explains (least squares).

    Points are eliminated first, each by its own 3 x 3 block, so that a dense system of the cameras' size is left.
    """
    from scipy import sparse

    n_points = by_point.shape[1] // 3
    normal = (by_point.T @ by_point).tobsr((3, 3))
    blocks = np.zeros((n_points, 3, 3))
    blocks[normal.indices] = normal.data
    # A point that images see from one direction only has no depth of its own.
    blocks += 1e-9 * (np.trace(blocks, axis1=1, axis2=2)[:, None, None] + 1e-12) * np.eye(3)
    inverse = sparse.bsr_matrix((np.linalg.inv(blocks), np.arange(n_points), np.arange(n_points + 1)))
    shared = by_point.T @ by_camera
    reduced = (by_camera.T @ by_camera - shared.T @ (inverse @ shared)).toarray()
    # Columns are brought to one size, for turns, shifts and lens have different units. Least norm: position, turn and
    # size of the whole are free.
    sizes = np.sqrt(np.maximum(np.diag(reduced), 1e-300))
    scaled = reduced / sizes / sizes[:, None]

    def unexplained(vector: Float64) -> Float64:
        right = by_camera.T @ vector - shared.T @ (inverse @ (by_point.T @ vector))
        cameras = np.linalg.lstsq(scaled, right / sizes, rcond=1e-10)[0] / sizes
        rest = vector - by_camera @ cameras
        left: Float64 = rest - by_point @ (inverse @ (by_point.T @ rest))
        return left

    return unexplained
