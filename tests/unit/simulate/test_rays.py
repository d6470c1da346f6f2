# SPDX-License-Identifier: Apache-2.0
"""Rays of the simulator: what they hit, and that both libraries say the same."""

import sys

import numpy as np
import pytest

from cotton3dg.core import libraries
from cotton3dg.errors import EnvironmentUnusable
from cotton3dg.simulate import rays

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]])
SHIFTED = SQUARE[0] + (0.5, 0, 1), SQUARE[1]
BUILDERS = pytest.mark.parametrize("build", [rays._Embreex, rays._Open3d])


def built(build, *meshes):
    if build is rays._Embreex:
        pytest.importorskip("embreex")
    return build([(vertices.astype(np.float32), triangles.astype(np.int32)) for vertices, triangles in meshes])


@BUILDERS
def test_the_nearest_mesh_is_hit(build):
    scene = built(build, SQUARE, SHIFTED)
    origins = np.float32([[0.6, 0.1, 3], [-0.9, -0.5, 3], [9, 0, 3]])
    hits = scene.cast(origins, np.float32([[0, 0, -2]]))
    np.testing.assert_allclose(hits.depths, [1.0, 1.5, np.inf], atol=1e-6)  # in lengths of the direction
    assert hits.meshes.tolist() == [1, 0, -1]
    assert (hits.triangles[:2] >= 0).all()
    assert hits.triangles[2] == -1
    corners = SQUARE[0][SQUARE[1][hits.triangles[1]]]
    u, v = hits.weights[1]
    np.testing.assert_allclose((1 - u - v) * corners[0] + u * corners[1] + v * corners[2], [-0.9, -0.5, 0], atol=1e-6)


@BUILDERS
def test_only_what_is_within_reach_blocks(build):
    scene = built(build, SQUARE)
    down = np.float32([0, 0, -1])
    assert scene.blocked(np.float32([[0, 0.1, 1], [0, 0.1, 3], [5, 5, 1]]), down, 2).tolist() == [True, False, False]
    assert scene.blocked(np.float32([[0, 0.1, 3]]), down).tolist() == [True]


@BUILDERS
def test_one_direction_for_many_rays_is_that_of_each(build):
    scene = built(build, SQUARE)
    origins = np.random.default_rng(5).uniform((-2, -2, 1), (2, 2, 3), (20000, 3)).astype(np.float32)
    down = np.float32([0, 0, -1])
    blocked = scene.blocked(origins, down)
    np.testing.assert_array_equal(blocked, (np.abs(origins[:, :2]) < 1).all(axis=1))
    np.testing.assert_array_equal(blocked, scene.blocked(origins, np.tile(down, (len(origins), 1))))


def test_both_libraries_give_the_same_hits():
    """Nearly: their single precision rounds differently, and differently on each processor."""
    rng = np.random.default_rng(3)
    corners = rng.normal(size=(2000, 1, 3)) + 0.1 * rng.normal(size=(2000, 3, 3))
    meshes = SQUARE, (corners.reshape(-1, 3), np.arange(6000).reshape(-1, 3))
    first, second = built(rays._Embreex, *meshes), built(rays._Open3d, *meshes)
    origins = rng.normal(size=(20000, 3)).astype(np.float32)
    directions = rng.normal(size=(20000, 3)).astype(np.float32)
    ours, theirs = first.cast(origins, directions), second.cast(origins, directions)
    hit = ours.meshes >= 0
    assert 2000 < hit.sum() < 20000
    np.testing.assert_array_equal(ours.meshes, theirs.meshes)
    np.testing.assert_array_equal(ours.triangles, theirs.triangles)
    assert np.isinf(ours.depths[~hit]).all() and np.isinf(theirs.depths[~hit]).all()
    triangles = [vertices.astype(np.float32).astype(float)[faces] for vertices, faces in meshes]
    a, b, c = np.moveaxis(
        np.array([triangles[m][t] for m, t in zip(ours.meshes[hit], ours.triangles[hit], strict=True)]), 1, 0
    )
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    starts, ways = origins[hit].astype(float), directions[hit].astype(float)
    towards = (normals * ways).sum(axis=1)
    expected = (normals * (a - starts)).sum(axis=1) / towards
    # Coordinates of a few units are rounded to some 2e-7, several times; it matters more the more the ray slants.
    slack = 1e-5 / np.abs(towards)
    for found in (ours, theirs):
        assert (np.abs(found.depths[hit] - expected) < slack).all()
        u, v = found.weights[hit].astype(float).T[:, :, None]
        gaps = np.linalg.norm((1 - u - v) * a + u * b + v * c - starts - expected[:, None] * ways, axis=1)
        assert (gaps < slack * np.linalg.norm(ways, axis=1)).all()
    blocked = first.blocked(origins, directions, 1.5)
    assert 2000 < blocked.sum() < 20000
    np.testing.assert_array_equal(blocked, second.blocked(origins, directions, 1.5))


def test_without_embreex_open3d_serves(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    assert isinstance(rays.build_rays([SQUARE]), rays._Open3d)


@pytest.mark.parametrize(
    ("said", "remedy"),
    [
        ("libGL.so.1: cannot open shared object file", "apt-get install libgl1 libegl1 libx11-6 libusb-1.0-0"),
        ("libodd.so.3: cannot open shared object file", "package that has libodd.so.3"),
        ("numpy is too old", "pip install"),
    ],
)
def test_an_open3d_that_cannot_be_loaded_names_what_to_do(monkeypatch, said, remedy):
    def refuse(name, *rest, **more):
        if name == "open3d":
            raise ImportError(said)
        return real(name, *rest, **more)

    real = __import__
    monkeypatch.setattr("builtins.__import__", refuse)
    with pytest.raises(EnvironmentUnusable, match=remedy):
        libraries.import_open3d()
