"""The walk around the plant: how much of the circle its images cover, and which of them miss the plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera

GAP_BIN_DEG = 15.0
"""Camera directions farther apart than this leave a gap; bolls still overlap in views 15 degrees apart."""


@dataclass(frozen=True)
class Coverage:
    """How the cameras stand around what they look at."""

    axis: NDArray[np.float64]
    """(3,) unit vector, the normal of the plane that the camera path lies in best."""
    target: NDArray[np.float64]
    """(3,) point nearest to all viewing rays, su."""
    radius_su: float
    """Median distance of the cameras from the target."""
    coverage_deg: float
    """Of 360, what is left when every gap beyond GAP_BIN_DEG is taken away."""
    largest_gap_deg: float


def out_of_view(target: NDArray, cameras: Sequence[Camera]) -> list[str]:
    """Names of the images that do not show the (3,) `target`, su: the plant has left the frame."""
    lost = []
    for camera in cameras:
        pixels, _ = camera.project(np.asarray(target)[None])
        if not ((pixels[0] >= 0) & (pixels[0] <= (camera.width, camera.height))).all():
            lost.append(camera.name)
    return lost


def coverage(centres: NDArray, forwards: NDArray) -> Coverage:
    """Measure the walk of cameras around what they look at.

    Args:
        centres: (n, 3) su, n >= 3. forwards: (n, 3) unit viewing directions.
    """
    # Point nearest to the viewing rays: sum over cameras of (I - d dᵀ)(x - c) = 0. The small share of the
    # identity keeps parallel rays solvable.
    centre = centres.mean(axis=0)
    across = np.eye(3) - forwards[:, :, None] * forwards[:, None, :]
    pulls = across + 1e-6 * np.eye(3)
    target = centre + np.linalg.solve(pulls.sum(axis=0), np.einsum("nij,nj->i", pulls, centres - centre))
    _, _, directions = np.linalg.svd(centres - centre)
    x, y, axis = directions
    angles = np.degrees(np.arctan2((centres - target) @ y, (centres - target) @ x))
    angles = np.sort(angles % 360.0)
    gaps = np.diff(np.append(angles, angles[0] + 360.0))
    return Coverage(
        axis=axis,
        target=target,
        radius_su=float(np.median(np.linalg.norm(centres - target, axis=1))),
        coverage_deg=float(360.0 - np.maximum(gaps - GAP_BIN_DEG, 0.0).sum()) if len(angles) > 1 else 0.0,
        largest_gap_deg=float(gaps.max()),
    )
