# SPDX-License-Identifier: Apache-2.0
"""Where the cameras stand around the plant, and which of them to choose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float64

ARC_PRIOR: Final = 0.01
"""Weight of the mean of the cameras' up vectors beside their horizontals, so that a short arc has an up direction."""
GAP_BIN_DEG: Final = 15.0
"""Camera directions farther apart than this leave a gap; bolls still overlap in views 15 degrees apart."""


def find_up(cameras: Sequence[Camera]) -> Float64:
    """(3,) unit vector upwards in the scene, by cameras that are held level.

    The direction to which the cameras' horizontal axes are most nearly perpendicular (Brown and Lowe, IJCV 2007,
    section 5). The mean of their up vectors leans by up to five degrees where a turn is not whole, as all look down.
    """
    rights = np.stack([camera.rotation[0] for camera in cameras])
    mean = -np.mean([camera.rotation[1] for camera in cameras], axis=0)
    up = np.linalg.solve(rights.T @ rights / len(cameras) + ARC_PRIOR * np.eye(3), mean)
    return np.asarray(up / np.linalg.norm(up))


@dataclass(frozen=True)
class Orbit:
    """The path of cameras that look at one plant from around it."""

    centre: Float64
    """(3,) su, where the optical axes meet."""
    axis: Float64
    """(3,) unit vector, up."""
    radius: float
    """su, median distance of the cameras from the axis."""
    distance: float
    """su, median distance of the cameras from the centre."""
    coverage_deg: float
    """360 degrees without all gaps beyond GAP_BIN_DEG."""
    largest_gap_deg: float


def fit_orbit(cameras: Sequence[Camera]) -> Orbit:
    """The orbit that the cameras follow, wherever on it they stand and however often they pass.

    The axis is the normal of the cameras' plane, or the mean of their up vectors where the path is too short or too
    uneven to have a plane. The centre is the point closest to the optical axes, with distances weighted by Cauchy's
    function, because a hand now and then points elsewhere and would move the point of plain least squares.

    One camera alone has an orbit of size zero at its own place.

    Raises:
        ValueError: no camera.
    """
    if not len(cameras):
        raise ValueError("an orbit needs cameras, got none")
    centres = np.stack([camera.centre for camera in cameras])
    forwards = np.stack([camera.forward for camera in cameras])
    up = -np.stack([camera.rotation[1] for camera in cameras]).mean(axis=0)
    _, spreads, directions = np.linalg.svd(centres - centres.mean(axis=0))
    # A sixth of the length is the sagitta of an arc of about 75 degrees; shorter ones do not define their plane well.
    planar = len(cameras) > 2 and spreads[1] > spreads[0] / 6 and spreads[2] < spreads[1] / 2
    axis = directions[2] * (1.0 if directions[2] @ up >= 0 else -1.0) if planar else up / np.linalg.norm(up)

    across = np.eye(3) - forwards[:, :, None] * forwards[:, None, :]
    weights = np.ones(len(cameras))
    for _ in range(10):
        # The small ridge keeps parallel axes from sending the point to infinity.
        normal = (weights[:, None, None] * across).sum(axis=0) + 1e-6 * weights.sum() * np.eye(3)
        pulled = (weights[:, None, None] * across @ centres[:, :, None]).sum(axis=0)[:, 0]
        centre = np.linalg.solve(normal, pulled + 1e-6 * weights.sum() * centres.mean(axis=0))
        misses = np.linalg.norm((across @ (centre - centres)[:, :, None])[:, :, 0], axis=1)
        weights = 1.0 / (1.0 + (misses / max(float(np.median(misses)), 1e-12)) ** 2)
    offsets = centres - centre
    level = offsets - np.outer(offsets @ axis, axis)
    angles = np.sort(np.degrees(_angles(offsets, axis)))
    gaps = np.diff(angles, append=angles[0] + 360.0)
    return Orbit(
        centre,
        axis,
        radius=float(np.median(np.linalg.norm(level, axis=1))),
        distance=float(np.median(np.linalg.norm(offsets, axis=1))),
        coverage_deg=float(360.0 - np.maximum(gaps - GAP_BIN_DEG, 0.0).sum()),
        largest_gap_deg=float(gaps.max()),
    )


def azimuths(cameras: Sequence[Camera], orbit: Orbit) -> Float64:
    """(V,) angle of each camera around the orbit's axis, 0..2π, from the first camera on."""
    return _angles(np.stack([camera.centre for camera in cameras]) - orbit.centre, orbit.axis)


def _angles(offsets: Float64, axis: Float64) -> Float64:
    """(V,) angle of each of the (V, 3) offsets around `axis`, 0..2π, from the first one on."""
    x = offsets[0] - axis * (offsets[0] @ axis)
    x /= max(float(np.linalg.norm(x)), 1e-12)
    y = np.cross(axis, x)
    angles: Float64 = np.mod(np.arctan2(offsets @ y, offsets @ x), 2 * np.pi)
    angles[0] = 0.0  # rounding could put it a hair before the beginning, at 2π
    return angles


def evenly_spaced(angles: NDArray[Any], count: int) -> NDArray[np.int64]:
    """Indices, ascending, of at most `count` angles (radians) spread as evenly around the circle as they allow.

    The first is kept and each next one is the farthest from all that are kept; ties go to the lower index.
    """
    angles = np.asarray(angles, np.float64)
    if len(angles) <= count:
        return np.arange(len(angles))
    chosen = [0]
    gaps = _gap(angles, angles[0])
    while len(chosen) < count:
        # Rounded, so that the choice does not depend on the last bit.
        chosen.append(int(np.argmax(np.round(np.where(np.isin(np.arange(len(angles)), chosen), -1.0, gaps), 9))))
        gaps = np.minimum(gaps, _gap(angles, angles[chosen[-1]]))
    return np.sort(np.array(chosen, np.int64))


def find_out_of_view(target: NDArray[Any], cameras: Sequence[Camera]) -> list[str]:
    """Names of the images that do not show the (3,) `target`, su: the plant has left the frame."""
    lost = []
    for camera in cameras:
        pixels, _ = camera.project(np.asarray(target)[None])
        if not ((pixels[0] >= 0) & (pixels[0] <= (camera.width, camera.height))).all():
            lost.append(camera.name)
    return lost


def within_orbit(means: NDArray[np.float32], cameras: Sequence[Camera], orbit: Orbit) -> NDArray[np.bool_]:
    """Which of the (N, 3) points lie inside the camera path, where the plant stands; walls and furniture do not.

    Args:
        means: (N, 3) su.
        orbit: of the cameras.
    Returns:
        (N,) points nearer to the centre than 0.8 of the cameras' distance; all points if they do not look inwards.
    """
    ahead = np.median([(orbit.centre - camera.centre) @ camera.forward for camera in cameras])
    if not ahead > 0.5 * orbit.distance:
        return np.ones(len(means), bool)
    near: NDArray[np.bool_] = np.linalg.norm(means - orbit.centre, axis=1) < 0.8 * orbit.distance
    return near


def _gap(angles: Float64, other: float) -> Float64:
    return np.abs(np.mod(angles - other + np.pi, 2 * np.pi) - np.pi)
