# SPDX-License-Identifier: Apache-2.0
"""Rays through triangles by Embree: by embreex, or by Open3D where embreex has no wheel; both agree up to rounding."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.libraries import import_open3d
from ..core.scene import Float32


class Hits(NamedTuple):
    """The first hit of each of N rays."""

    depths: Float32
    """(N,) in lengths of the ray's direction; infinite where it meets nothing."""
    meshes: NDArray[np.int64]
    """(N,) which mesh, -1 = nothing."""
    triangles: NDArray[np.int64]
    """(N,) which triangle of it, -1 = nothing."""
    weights: Float32
    """(N, 2) barycentric weights of the triangle's second and third corner."""


def interpolate(values: Float32, corners: NDArray[np.integer], weights: Float32) -> Float32:
    """(N, C) values of vertices, (V, C), interpolated within triangles with these corners, (N, 3).

    Args:
        weights: (N, 2) as in `Hits`.
    """
    u, v = weights.T[..., None]
    a, b, c = (values[corners[:, k]] for k in range(3))
    between: Float32 = (1 - u - v) * a + u * b + v * c
    return between


class Rays(Protocol):
    """Meshes at which rays are cast. Origins and directions are (N, 3); a direction need not have length 1."""

    def cast(self, origins: Float32, directions: Float32) -> Hits: ...

    def blocked(self, origins: Float32, directions: Float32, reach: float = np.inf) -> NDArray[np.bool_]:
        """(N,) whether anything is nearer than `reach`, in lengths of the direction."""


def build_rays(meshes: Sequence[tuple[NDArray[Any], NDArray[Any]]]) -> Rays:
    """The ray tracer of meshes, each with (V, 3) vertices and (T, 3) triangles.

    Raises:
        EnvironmentUnusable: neither library can be imported.
    """
    kinds = [(vertices.astype(np.float32), triangles.astype(np.int32)) for vertices, triangles in meshes]
    try:
        return _Embreex(kinds)
    except ImportError:
        return _Open3d(kinds)


class _Embreex:
    def __init__(self, meshes: Sequence[tuple[Float32, NDArray[np.int32]]]) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.scene = EmbreeScene()
        for vertices, triangles in meshes:
            TriangleMesh(self.scene, vertices, triangles)

    def cast(self, origins: Float32, directions: Float32) -> Hits:
        found = self.scene.run(*_rows(origins, directions), query="INTERSECT", output=1)
        meshes = found["geomID"].astype(np.int64)
        depths = np.where(meshes < 0, np.float32(np.inf), found["tfar"])
        return Hits(depths, meshes, found["primID"].astype(np.int64), np.stack([found["u"], found["v"]], axis=1))

    def blocked(self, origins: Float32, directions: Float32, reach: float = np.inf) -> NDArray[np.bool_]:
        starts, towards = _rows(origins, directions)
        limits = np.full(len(starts), reach, np.float32)
        blocked: NDArray[np.bool_] = self.scene.run(starts, towards, dists=limits, query="OCCLUDED") == 0
        return blocked


class _Open3d:
    def __init__(self, meshes: Sequence[tuple[Float32, NDArray[np.int32]]]) -> None:
        o3d = import_open3d()
        self.tensor = o3d.core.Tensor.from_numpy
        self.scene = o3d.t.geometry.RaycastingScene()
        for vertices, triangles in meshes:
            self.scene.add_triangles(self.tensor(vertices), self.tensor(triangles.astype(np.uint32)))

    def cast(self, origins: Float32, directions: Float32) -> Hits:
        tensors = self.scene.cast_rays(self._bundle(origins, directions))
        found = {name: values.numpy() for name, values in tensors.items()}
        meshes, triangles = (
            found[f"{kind}_ids"].astype(np.int32).astype(np.int64) for kind in ("geometry", "primitive")
        )
        return Hits(found["t_hit"], meshes, triangles, found["primitive_uvs"])

    def blocked(self, origins: Float32, directions: Float32, reach: float = np.inf) -> NDArray[np.bool_]:
        blocked: NDArray[np.bool_] = self.scene.test_occlusions(self._bundle(origins, directions), tfar=reach).numpy()
        return blocked

    def _bundle(self, origins: Float32, directions: Float32) -> Any:
        return self.tensor(np.concatenate(_rows(origins, directions), axis=1))


def _rows(origins: Float32, directions: Float32) -> tuple[Float32, Float32]:
    """Both as (N, 3) in memory; one origin or direction may serve all rays."""
    pair = np.broadcast_arrays(np.atleast_2d(origins), np.atleast_2d(directions))
    first, second = (np.ascontiguousarray(array, np.float32) for array in pair)
    return first, second
