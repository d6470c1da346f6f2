"""The walk around the plant: which images to match with each other, and how much of the circle they cover."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera

GAP_BIN_DEG = 15.0
"""Camera directions farther apart than this leave a gap; bolls still overlap in views 15 degrees apart."""


def image_pairs(n: int, overlap: int, ordered: bool) -> list[tuple[int, int]]:
    """Pairs of images to match.

    Images in order of time are matched with the next `overlap` / 2 and then with ever farther ones, each distance about
    1.4 times the one before, for as many again: near ones give many matches, far ones stiffness. The order is
    taken as a ring, so that a full turn closes without a search for loops. Every `overlap`-th image is matched with
    every other such one, which ties a second turn, or a walk back, to the first. Unordered images are matched with all
    others while that is cheap, else as if twice as dense.

    Returns:
        Ascending (i, j) with i < j, each once.
    """
    if not ordered and n <= 60:
        return [(i, j) for i in range(n) for j in range(i + 1, n)]
    if not ordered:
        overlap *= 2
    near = max(1, (overlap + 1) // 2)
    offsets = list(range(1, near + 1))
    while len(offsets) < overlap:
        offsets.append(max(offsets[-1] + 1, round(offsets[-1] * 1.4)))
    ring = {(i, (i + d) % n) for d in offsets for i in range(n)}
    ties = {(i, j) for i in range(0, n, overlap) for j in range(i, n, overlap)}
    return sorted({(min(i, j), max(i, j)) for i, j in ring | ties if i != j})


@dataclass(frozen=True)
class Orbit:
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


def orbit(centres: NDArray, forwards: NDArray) -> Orbit:
    """Measure the orbit of cameras.

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
    return Orbit(
        axis=axis,
        target=target,
        radius_su=float(np.median(np.linalg.norm(centres - target, axis=1))),
        coverage_deg=float(360.0 - np.maximum(gaps - GAP_BIN_DEG, 0.0).sum()) if len(angles) > 1 else 0.0,
        largest_gap_deg=float(gaps.max()),
    )
