# SPDX-License-Identifier: Apache-2.0
"""Meshes that are closed, with their normals outside."""

import numpy as np
import pytest
from scenes.simulated_plant import signed_volume

from cotton3dg.simulate.mesh import Mesh, icosphere, sheet, smooth_curve, tube


def is_closed(mesh: Mesh) -> bool:
    edges = {(int(t[i]), int(t[(i + 1) % 3])) for t in mesh.triangles for i in range(3)}
    return len(edges) == 3 * len(mesh.triangles) and all((b, a) in edges for a, b in edges)


def test_meshes_are_closed_and_face_outwards():
    sphere = Mesh(*icosphere(3), np.zeros((642, 3)))
    curve = smooth_curve([(0, 0, 0), (0.01, 0, 0.1), (0, 0, 0.2)], 0.005)
    twig = tube(curve, np.full(len(curve), 0.01), np.zeros((len(curve), 3)), sides=32)
    grid = np.stack(np.meshgrid(np.linspace(0, 2, 5), np.linspace(0, 1, 7), 0.0, indexing="ij"), axis=-1)[:, :, 0]
    plate = sheet(grid, np.zeros((5, 7, 3)), 0.01)
    for mesh, volume in ((sphere, 4 / 3 * np.pi), (twig, np.pi * 1e-4 * 0.2), (plate, 0.02)):
        assert is_closed(mesh)
        assert signed_volume(mesh) == pytest.approx(volume, rel=0.03)
    np.testing.assert_allclose(sphere.normals(), sphere.vertices, atol=0.02)
