# SPDX-License-Identifier: Apache-2.0
"""Boxes around point sets of any rank: minimum-area rectangle in the plane, oriented box in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

TIE: Final = 0.01
"""Relative difference below which two sides count as equal, so that the choice between their axes is arbitrary."""


@dataclass(frozen=True)
class Box:
    """A box in 2 or 3 dimensions, longest side first."""

    centre: NDArray[np.float64]
    """(D,)"""
    axes: NDArray[np.float64]
    """(D, D) rows: unit axes, right-handed."""
    sides: NDArray[np.float64]
    """(D,) descending; 0 along axes in which the set has no extent."""
    tie: bool
    """Two neighbouring sides are equal within 1 %: the axes are arbitrary, the sides are not."""

    @property
    def corners(self) -> NDArray[np.float64]:
        """(4, 2) corners of a rectangle in order around it; edge 0-1 is a long side."""
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
        return self.centre + signs * self.sides @ self.axes


def min_area_rectangle(points: NDArray[Any]) -> Box:
    """The rectangle of least area around (N, 2) points, N > 0 (Freeman and Shapira 1975).

    One of its sides lies on a side of the convex hull, so those directions are tried, all at once. The first of equally
    small ones wins.
    """
    points = _check(points, 2)
    axes, sides = _rectangles(points)
    return _box_along(points, axes[int(np.argmin(sides.prod(axis=1)))])


def nearly_least_rectangles(points: NDArray[Any], share: float) -> NDArray[np.float64]:
    """(K, 2) sides of the rectangles around (N, 2) points, N > 0, that have a side on their hull's and at most so much
    more area than the least, as a share of it."""
    _, sides = _rectangles(_check(points, 2))
    areas = sides.prod(axis=1)
    least: NDArray[np.float64] = sides[areas <= (1 + share) * areas.min()]
    return least


def oriented_box(points: NDArray[Any]) -> Box:
    """Box of (N, 3) points, N > 0, along the principal axes of their convex hull.

    The hull's corners instead of all points keep dense parts from turning the box, as in Open3D's oriented bounding
    box; unlike there a set without volume gets a box too.
    """
    points = _check(points, 3)
    corners = _hull_corners(points - points.mean(axis=0))
    return _box_along(points, _principal_axes(corners))


def standing_box(points: NDArray[Any]) -> Box:
    """The box around (N, 3) points, N > 0, that has a side along z and else the least area seen along it.

    Of a flat and level cloud this is the tightest box. Principal axes of its hull's corners turn where one corner of
    the cloud is frayed: around a table by degrees.
    """
    points = _check(points, 3)
    axes = np.eye(3)
    axes[:2, :2] = min_area_rectangle(points[:, :2]).axes
    return _box_along(points, axes)


def fibonacci_directions(count: int) -> NDArray[np.float64]:
    """(count, 3) unit vectors spread evenly over the sphere."""
    index = np.arange(count) + 0.5
    z = 1 - 2 * index / count
    angle = np.pi * (1 + 5**0.5) * index
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def _rectangles(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Axes (S, 2, 2), in rows, and lengths (S, 2) of the sides along them, of the rectangle on each side of the hull of
    (N, 2) points."""
    corners = _hull_corners(points - points.mean(axis=0))
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(sides, axis=1)
    along = sides[lengths > 0] / lengths[lengths > 0, None] if (lengths > 0).any() else np.eye(2)[:1]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    extents = np.stack([np.ptp(corners @ along.T, axis=0), np.ptp(corners @ across.T, axis=0)], axis=1)
    return np.stack([along, across], axis=1), extents


def _box_along(points: NDArray[np.float64], axes: NDArray[np.float64]) -> Box:
    """The box around `points` along the rows of `axes`, sorted by length."""
    along = points @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    order = np.argsort(-(high - low), kind="stable")
    sides = (high - low)[order]
    tie = bool((sides[:-1] - sides[1:] <= TIE * sides[:-1]).any())
    sorted_axes = axes[order]
    if np.linalg.det(sorted_axes) < 0:
        sorted_axes[-1] *= -1
    return Box((low + high) / 2 @ axes, sorted_axes, sides, tie)


def _hull_corners(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners of the convex hull, in the plane counter-clockwise; those of a set without area or volume are the corners
    within its line or plane."""
    return points[_hull_rows(points)]


def _hull_rows(points: NDArray[np.float64]) -> NDArray[np.int64]:
    from scipy.spatial import ConvexHull, QhullError

    try:
        rows: NDArray[np.int64] = ConvexHull(points).vertices.astype(np.int64)
        return rows
    except (QhullError, ValueError):
        if len(points) < 3:
            return np.arange(len(points))
        axes = _principal_axes(points)
        if points.shape[1] == 3:
            return _hull_rows(points @ axes[:2].T)
        # A collinear set is described by the segment between its extremes.
        along = points @ axes[0]
        return np.array([int(along.argmin()), int(along.argmax())])


def _principal_axes(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(D, D) rows: unit axes, that of the widest spread first."""
    # The triangle of a QR decomposition has the same axes and no more than D rows.
    return np.linalg.svd(np.linalg.qr(points - points.mean(axis=0), mode="r"), full_matrices=True)[2]


def _check(points: NDArray[Any], dimensions: int) -> NDArray[np.float64]:
    points = np.asarray(points, np.float64)
    if points.ndim != 2 or points.shape[1] != dimensions or not len(points) or not np.isfinite(points).all():
        raise ValueError(f"a box needs finite points (N > 0, {dimensions}), got {points.shape}")
    return points
