# SPDX-License-Identifier: Apache-2.0
"""Volume and diameter of point sets, in their unit. Degenerate sets give NaN and a reason, never a guess."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .boxes import fibonacci_directions

FLAT: Final = 1e-5
"""Thickness of a set relative to its length below which it has no volume: ten times what float32 centres resolve."""


class Measured(NamedTuple):
    """A number, or NaN with the reason why there is none."""

    value: float
    reason: str = ""


def convex_volume(points: NDArray[Any]) -> Measured:
    """Volume of the convex hull of (N, 3) points."""
    centred, reason = solid_points(points)
    if reason:
        return Measured(np.nan, reason)
    from scipy.spatial import ConvexHull

    return Measured(float(ConvexHull(centred).volume))


def projected_area(points: NDArray[Any]) -> Measured:
    """Area of the shadow of the convex hull of (N, 3) points, mean over all directions.

    Cauchy: a quarter of a convex body's surface.
    """
    centred, reason = solid_points(points)
    if reason:
        return Measured(np.nan, reason)
    from scipy.spatial import ConvexHull

    return Measured(float(ConvexHull(centred).area) / 4)


def alpha_volume(points: NDArray[Any], alpha: float) -> Measured:
    """Volume that a ball of radius `alpha`, rolled over (N, 3) points from outside, cannot enter.

    This is the alpha shape (Edelsbrunner and Mücke 1994) with its cavities filled: Gaussians lie on the surface of a
    boll, so the shape itself would be a shell. A tetrahedron of the Delaunay triangulation is outside when a chain of
    faces leads to it from infinity that the ball passes, i.e. whose circumradius exceeds alpha.
    """
    centred, reason = solid_points(points)
    if reason:
        return Measured(np.nan, reason)
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import ConvexHull, Delaunay

    # Details much finer than the ball do not matter; the hull's corners keep the set solid.
    extent = float(np.ptp(centred, axis=0).max())
    cells = np.floor(centred / np.clip(alpha / 5, extent / 1e5, extent / 40)).astype(np.int64)
    firsts = np.unique(cells @ [1, 1 << 20, 1 << 40], return_index=True)[1]
    mesh = Delaunay(centred[np.union1d(firsts, ConvexHull(centred).vertices)])
    n = len(mesh.simplices)
    corners = mesh.points[mesh.simplices]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    # Face k of a tetrahedron lies opposite to its corner k; beyond the hull is one node, number n.
    faces = np.stack([np.delete(corners, k, axis=1) for k in range(4)], axis=1)
    passable = _circumradii(faces) > alpha
    beyond = np.where(mesh.neighbors < 0, n, mesh.neighbors)
    rows, columns = np.repeat(np.arange(n), 4)[passable.ravel()], beyond.ravel()[passable.ravel()]
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(n + 1, n + 1))
    parts = connected_components(graph, directed=False)[1]
    return Measured(float(volumes[parts[:n] != parts[n]].sum()))


def calliper_diameter(points: NDArray[Any]) -> Measured:
    """Mean calliper width of the convex hull of (N, 3) points over all directions."""
    centred, reason = solid_points(points)
    if reason:
        return Measured(np.nan, reason)
    from scipy.spatial import ConvexHull

    corners = centred[ConvexHull(centred).vertices]
    return Measured(float(np.ptp(corners @ fibonacci_directions(256).T, axis=0).mean()))


def solid_points(points: NDArray[Any]) -> tuple[NDArray[np.float64], str]:
    """The points in float64, centred, and why they span no volume ('' when they do)."""
    points = np.asarray(points, np.float64).reshape(-1, 3)
    if not np.isfinite(points).all():
        return points, "not_finite"
    if len(points) < 4:
        return points, "too_few_points"
    if (np.ptp(points, axis=0) == 0).all():
        return points, "coincident_points"
    # Centred before anything else: far from the origin the hull's determinants would cancel.
    points = points - points.mean(axis=0)
    spread = np.linalg.svd(points, compute_uv=False)
    if spread[1] <= FLAT * spread[0]:
        return points, "collinear_points"
    if spread[2] <= FLAT * spread[0]:
        return points, "flat_points"
    return points, ""


def _circumradii(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...) radius of the circle through the corners of (..., 3, 3) triangles; infinite for slivers."""
    a, b, c = (triangles[..., k, :] - triangles[..., k - 1, :] for k in range(3))
    doubled_area = np.linalg.norm(np.cross(a, b), axis=-1)
    product = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1) * np.linalg.norm(c, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(doubled_area > 0, product / (2 * doubled_area), np.inf)
