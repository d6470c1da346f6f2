# SPDX-License-Identifier: Apache-2.0
"""The workspace of the scale stage: a table filmed from around it, as COLMAP model, photos and Gaussians."""

import struct

import numpy as np
from scipy.spatial.transform import Rotation

from cotton3dg.io.images import write_image
from cotton3dg.io.ply import write_gaussians
from cotton3dg.workspace import Workspace
from scenes.table_scene import POSE, gaussians_at, table_points_cm


def write_colmap(folder, cameras, points):
    folder.mkdir(parents=True)
    c = cameras[0]
    (folder / "cameras.bin").write_bytes(struct.pack("<QiiQQ4d", 1, 1, 1, c.width, c.height, c.fx, c.fy, c.cx, c.cy))
    images = [struct.pack("<Q", len(cameras))]
    for number, camera in enumerate(cameras, 1):
        x, y, z, w = Rotation.from_matrix(camera.rotation).as_quat()
        row = struct.pack("<I7dI", number, w, x, y, z, *camera.cam_from_scene[:, 3], 1)
        images.append(row + camera.name.encode() + b"\0" + struct.pack("<Q", 0))
    (folder / "images.bin").write_bytes(b"".join(images))
    rows = [struct.pack("<Q3d3BdQ", n, *point, 128, 128, 128, 0.5, 0) for n, point in enumerate(points, 1)]
    (folder / "points3D.bin").write_bytes(struct.pack("<Q", len(points)) + b"".join(rows))


def table_workspace(folder, cameras, photos):
    workspace = Workspace(folder)
    points = POSE.scene(table_points_cm(np.random.default_rng(0)))
    write_colmap(workspace.undistorted / "sparse", cameras, points)
    (workspace.undistorted / "images").mkdir()
    for camera, image in zip(cameras, photos, strict=True):
        write_image(workspace.undistorted_image(camera.name), image)
    workspace.gaussians_ply.parent.mkdir()
    write_gaussians(workspace.gaussians_ply, gaussians_at(table_points_cm(np.random.default_rng(1), 500), 0.3))
    return workspace
