# SPDX-License-Identifier: Apache-2.0
"""Coloured triangle meshes: the shapes that plants are made of.

Lengths are metres, colours linear RGB albedo in 0..1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates, spline_filter

from ..core.scene import Float64


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh with one colour a vertex."""

    vertices: Float64
    """(V, 3) m."""
    triangles: NDArray[np.int32]
    """(T, 3) vertex indices, counter-clockwise seen from outside."""
    colours: Float64
    """(V, 3) linear RGB albedo."""

    def normals(self) -> Float64:
        """(V, 3) unit vertex normals, weighted by the area of the triangles; up where all triangles are degenerate."""
        a, b, c = (self.vertices[self.triangles[:, corner]] for corner in range(3))
        faces = np.cross(b - a, c - a)
        normals = np.stack(
            [np.bincount(self.triangles.ravel(), np.repeat(axis, 3), len(self.vertices)) for axis in faces.T], axis=1
        )
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.where(lengths > 1e-20, normals / np.maximum(lengths, 1e-20), (0.0, 0.0, 1.0))

    def moved(self, rotation: Float64, offset: ArrayLike) -> Mesh:
        """The mesh turned by a (3, 3) rotation, then shifted by (3,) m."""
        return replace(self, vertices=self.vertices @ rotation.T + np.asarray(offset))


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """All meshes as one, in order."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=True)]).astype(np.int32),
        np.concatenate([mesh.colours for mesh in meshes]),
    )


class SolidNoise:
    """Smooth random field in space, periodic, about uniform in -1..1: a cubic spline through a random lattice."""

    PERIOD = 32

    def __init__(self, rng: np.random.Generator):
        lattice = rng.uniform(-1.6, 1.6, (self.PERIOD,) * 3)
        self._coefficients = spline_filter(lattice, order=3, mode="grid-wrap")

    def __call__(self, points: Float64, wavelength: float) -> Float64:
        """(N,) values at (N, 3) m; `wavelength` in m is twice the lattice's spacing."""
        values: Float64 = map_coordinates(
            self._coefficients, (points / (0.5 * wavelength)).T, order=3, mode="grid-wrap", prefilter=False
        )
        return values


def unit(vector: ArrayLike) -> Float64:
    """The vector(s) at length one."""
    array = np.asarray(vector, np.float64)
    scaled: Float64 = array / np.linalg.norm(array, axis=-1, keepdims=True)
    return scaled


def rotation_to(axis: ArrayLike, turn: float = 0.0) -> Float64:
    """(3, 3) rotation that takes z to `axis`, after a turn about z in rad."""
    z = unit(axis)
    x = unit(np.cross((0.0, 1.0, 0.0) if abs(z[1]) < 0.9 else (1.0, 0.0, 0.0), z))
    cos, sin = np.cos(turn), np.sin(turn)
    rotation: Float64 = np.stack([x, np.cross(z, x), z], axis=1) @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    return rotation


def smooth_curve(points: ArrayLike, spacing: float) -> Float64:
    """(N, 3) points along a Catmull-Rom spline through (K, 3) `points`, about `spacing` m apart."""
    knots = np.asarray(points, np.float64)
    padded = np.concatenate([[2 * knots[0] - knots[1]], knots, [2 * knots[-1] - knots[-2]]])
    pieces = []
    for p0, p1, p2, p3 in zip(padded, padded[1:], padded[2:], padded[3:], strict=False):
        t = np.linspace(0, 1, max(2, int(np.linalg.norm(p2 - p1) / spacing)), endpoint=False)[:, None]
        pieces.append(p1 + 0.5 * t * (p2 - p0 + t * (2 * p0 - 5 * p1 + 4 * p2 - p3 + t * (3 * (p1 - p2) + p3 - p0))))
    return np.concatenate([*pieces, knots[-1:]])


def tube(curve: Float64, radii: Float64, colours: Float64, sides: int = 12) -> Mesh:
    """A closed tube around a curve.

    Args:
        curve: (N, 3) m.
        radii: (N,) m, or (N, sides) for a rough surface.
        colours: (N, 3).
    """
    n = len(curve)
    tangents = unit(np.gradient(curve, axis=0))
    side = unit(np.cross(tangents[0], (0.3, 1.0, 0.2)))
    frames = np.empty((n, 2, 3))
    for knot, tangent in enumerate(tangents):
        # Carrying the first normal along keeps the tube from twisting.
        side = unit(side - tangent * (side @ tangent))
        frames[knot] = side, np.cross(tangent, side)
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rough = np.broadcast_to(np.reshape(radii, (n, -1)), (n, sides))
    rings = curve[:, None] + rough[..., None] * np.einsum("sk,nkd->nsd", circle, frames)
    i, j = np.meshgrid(np.arange(n - 1), np.arange(sides), indexing="ij")
    a, b = i * sides + j, i * sides + (j + 1) % sides
    around = np.stack([a, b, b + sides, a, b + sides, a + sides], axis=-1).reshape(-1, 3)
    ring = np.arange(sides)
    following = np.roll(ring, -1)
    start = np.stack([np.full(sides, n * sides), following, ring], axis=1)
    end = np.stack([np.full(sides, n * sides + 1), (n - 1) * sides + ring, (n - 1) * sides + following], axis=1)
    return Mesh(
        np.concatenate([rings.reshape(-1, 3), curve[:1], curve[-1:]]),
        np.concatenate([around, start, end]).astype(np.int32),
        np.concatenate([np.repeat(colours, sides, axis=0), colours[:1], colours[-1:]]),
    )


def sheet(surface: Float64, colours: Float64, thickness: float) -> Mesh:
    """A thin closed plate around a grid of points.

    Args:
        surface: (N, M, 3) m.
        colours: (N, M, 3).
        thickness: m.
    """
    n, m = surface.shape[:2]
    across = np.cross(np.gradient(surface, axis=0), np.gradient(surface, axis=1))
    normals = across / np.maximum(np.linalg.norm(across, axis=2, keepdims=True), 1e-20)
    i, j = np.meshgrid(np.arange(n - 1), np.arange(m - 1), indexing="ij")
    a = (i * m + j).ravel()
    top = np.concatenate([np.stack([a, a + m, a + m + 1], axis=1), np.stack([a, a + m + 1, a + 1], axis=1)])
    rim = np.concatenate(
        [np.arange(m), np.arange(1, n) * m + m - 1, (n - 1) * m + np.arange(m - 2, -1, -1), np.arange(n - 2, 0, -1) * m]
    )
    following = np.roll(rim, -1)
    edge = np.concatenate(
        [np.stack([rim, following + n * m, rim + n * m], axis=1), np.stack([rim, following, following + n * m], axis=1)]
    )
    half = 0.5 * thickness * normals
    return Mesh(
        np.concatenate([(surface + half).reshape(-1, 3), (surface - half).reshape(-1, 3)]),
        np.concatenate([top, top[:, ::-1] + n * m, edge]).astype(np.int32),
        np.concatenate([colours.reshape(-1, 3)] * 2),
    )


@cache
def icosphere(subdivisions: int) -> tuple[Float64, NDArray[np.int32]]:
    """Vertices (V, 3) on the unit sphere and triangles (T, 3); V = 10 * 4^subdivisions + 2."""
    g = (1 + 5**0.5) / 2
    corners: list[tuple[float, float, float]]
    corners = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    corners += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    faces = "0b5 051 017 07a 0ab 159 5b4 ba2 a76 718 394 342 326 368 389 495 24b 62a 867 981"
    vertices = unit(corners)
    triangles = np.array([[int(digit, 16) for digit in face] for face in faces.split()])
    for _ in range(subdivisions):
        edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
        pairs, middle = np.unique(edges, axis=0, return_inverse=True)
        ab, bc, ca = middle.reshape(3, -1) + len(vertices)
        a, b, c = triangles.T
        vertices = np.concatenate([vertices, unit(vertices[pairs].sum(axis=1))])
        triangles = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    return vertices, triangles.astype(np.int32)
