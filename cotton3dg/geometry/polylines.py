# SPDX-License-Identifier: Apache-2.0
"""Curves in space as polylines: path lengths, resampling, smoothing, directions."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from ..core.scene import Float64

TOGETHER: Final = 100_000
"""Number of pairs of a place and a piece of a polyline that are computed at once."""


def path_lengths(points: NDArray[Any]) -> Float64:
    """(N,) length along a polyline (N, 3) from its first point to each."""
    lengths = np.zeros(max(len(points), 1))
    np.cumsum(np.sqrt(_squared(*(points[1:] - points[:-1]).T)), out=lengths[1:])
    return lengths


def length_of(points: NDArray[Any]) -> float:
    return float(path_lengths(points)[-1])


def place_at(points: NDArray[Any], length: float) -> Float64:
    """(3,) the place at a path length from the start; beyond an end, that end."""
    lengths = path_lengths(points)
    return np.array([np.interp(length, lengths, axis) for axis in np.asarray(points, np.float64).T])


def resampled(points: NDArray[Any], spacing: float) -> Float64:
    """(M, 3) points evenly along the polyline, about `spacing` apart; both ends stay."""
    lengths = path_lengths(points)
    wanted = np.linspace(0, lengths[-1], max(2, round(lengths[-1] / spacing) + 1))
    return np.column_stack([np.interp(wanted, lengths, axis) for axis in np.asarray(points, np.float64).T])


def smoothed(points: NDArray[Any], sigma: float) -> Float64:
    """(N, 3) points of an evenly spaced polyline, averaged over neighbours; both ends stay.

    Args:
        sigma: standard deviation of the Gaussian weights, in points.
    """
    points = np.asarray(points, np.float64)
    if len(points) < 3:
        return points
    # Mirrored about its ends, a curve keeps its ends and its directions there.
    pad = min(len(points) - 1, int(4 * sigma) + 1)
    before, after = 2 * points[0] - points[pad:0:-1], 2 * points[-1] - points[-2 : -pad - 2 : -1]
    whole: Float64 = gaussian_filter1d(np.concatenate([before, points, after]), sigma, axis=0)
    return whole[pad : pad + len(points)]


def piece_between(points: NDArray[Any], start: float, stop: float) -> Float64:
    """(M, 3) points of a polyline around the piece between two path lengths; backwards if `stop` is the smaller one."""
    lengths = path_lengths(points)
    low, high = min(start, stop), max(start, stop)
    first = int(np.clip(np.searchsorted(lengths, low + 1e-9, "right") - 1, 0, len(points) - 2))
    last = int(np.clip(np.searchsorted(lengths, high - 1e-9), first + 1, len(points) - 1))
    piece = points[first : last + 1]
    return piece if start < stop else piece[::-1]


def direction(points: NDArray[Any], start: float, stop: float) -> Float64:
    """(3,) unit vector of the chord between two path lengths; NaN where they are one place."""
    chord = place_at(points, stop) - place_at(points, start)
    length = float(np.linalg.norm(chord))
    return chord / length if length > 0 else np.full(3, np.nan)


def angle_deg(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Angle between two directions, degrees."""
    cosine = (a @ b) / (np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def nearest_on(points: NDArray[Any], places: NDArray[Any], within: float = np.inf) -> tuple[Float64, Float64]:
    """Distance (M,) of each of (M, 3) places to a polyline (N, 3), and the path length (M,) of the nearest point.

    Args:
        within: the distance of places farther away may be infinity, which is quicker if most are.
    """
    if np.isfinite(within) and len(places) > len(points):
        longest = np.sqrt(_squared(*np.diff(points, axis=0).T).max(initial=0.0))
        reach = within + 0.5 * longest + 1e-6
        near = np.flatnonzero(cKDTree(points).query(places, distance_upper_bound=reach)[0] < np.inf)
        best, station = np.full(len(places), np.inf), np.zeros(len(places))
        best[near], station[near] = nearest_on(points, places[near])
        return best, station
    start = np.asarray(points, np.float64)[:-1].T
    steps = np.diff(points, axis=0).T
    squares = np.maximum(_squared(*steps), 1e-18)
    lengths = path_lengths(points)
    best, station = np.full(len(places), np.inf), np.zeros(len(places))
    rows = max(1, TOGETHER // max(steps.shape[1], 1))
    for low in range(0, len(places) if steps.size else 0, rows):
        some = np.asarray(places[low : low + rows], np.float64).T[:, :, None]
        # One axis at a time: sums over an array's last three numbers take several times as long.
        x, y, z = (own - first for own, first in zip(some, start, strict=True))
        share = np.clip((x * steps[0] + y * steps[1] + z * steps[2]) / squares, 0, 1)
        away = _squared(x - share * steps[0], y - share * steps[1], z - share * steps[2])
        nearest = away.argmin(axis=1)
        own = np.arange(len(nearest))
        best[low : low + rows] = np.sqrt(away[own, nearest])
        station[low : low + rows] = lengths[nearest] + share[own, nearest] * np.sqrt(squares[nearest])
    return best, station


def _squared(x: Float64, y: Float64, z: Float64) -> Float64:
    return x * x + y * y + z * z
