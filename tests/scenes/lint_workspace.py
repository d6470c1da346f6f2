# SPDX-License-Identifier: Apache-2.0
"""A plant's folder as the stage sfm leaves it, of the room in lint_scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cotton3dg.core.scene import Camera
from cotton3dg.io.images import write_image
from cotton3dg.workspace import Workspace
from scenes.lint_scene import orbit_cameras, photo, table_points

N_IMAGES = 24


def write_sfm(root: Path, cameras: list[Camera]) -> None:
    """The undistorted model with points on the table; the model as filmed is the same."""
    import pycolmap

    model, first = pycolmap.Reconstruction(), cameras[0]
    intrinsics = [first.fx, first.fy, first.cx, first.cy]
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(model="PINHOLE", width=first.width, height=first.height, params=intrinsics, camera_id=1)
    )
    for i, camera in enumerate(cameras, 1):
        image = pycolmap.Image(name=camera.name, camera_id=1, image_id=i)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(camera.cam_from_scene))
    for point in table_points(2000):
        model.add_point3D(point, pycolmap.Track())
    for folder in (root / "sfm", root / "sfm" / "undistorted" / "sparse"):
        folder.mkdir(parents=True, exist_ok=True)
        model.write_binary(str(folder))


def make_workspace(root: Path, bolls: np.ndarray) -> tuple[Workspace, dict[str, np.ndarray]]:
    cameras = orbit_cameras(N_IMAGES)
    write_sfm(root, cameras)
    (root / "sfm" / "undistorted" / "images").mkdir()
    workspace, truths = Workspace(root), {}
    for camera in cameras:
        image, truths[camera.name] = photo(camera, bolls=bolls)
        write_image(workspace.undistorted_image(camera.name), image)
    return workspace, truths
