# SPDX-License-Identifier: Apache-2.0
"""Camera poses in the formats of other programs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera


def scene_from_cam(camera: Camera) -> NDArray[np.float64]:
    """(4, 4) pose of an OpenCV camera (x right, y down, z forward) in the scene."""
    pose = np.eye(4)
    pose[:3, :3] = camera.rotation.T
    pose[:3, 3] = camera.centre
    return pose


def nerfstudio_transforms(cameras: list[Camera], image_folder: str) -> dict[str, Any]:
    """Content of nerfstudio's transforms.json for pinhole cameras.

    Poses are scene-from-camera with OpenGL axes (x right, y up, z backward), the scene's own axes kept.
    Source: https://docs.nerf.studio/quickstart/data_conventions.html
    """
    opengl_from_opencv = np.diag([1.0, -1.0, -1.0, 1.0])
    return {
        "camera_model": "OPENCV",
        "frames": [
            {
                "file_path": f"{image_folder}/{camera.name}",
                "w": camera.width,
                "h": camera.height,
                "fl_x": camera.fx,
                "fl_y": camera.fy,
                "cx": camera.cx,
                "cy": camera.cy,
                "transform_matrix": (scene_from_cam(camera) @ opengl_from_opencv).tolist(),
            }
            for camera in cameras
        ],
    }


def llff_poses_bounds(cameras: list[Camera], points: NDArray[Any]) -> NDArray[np.float64]:
    """Content of LLFF's poses_bounds.npy, in the order of `cameras`.

    A row is a (3, 5) matrix, flattened, and the near and far depth of the scene in that view. The matrix holds
    scene-from-camera with LLFF's axes (down, right, backward) and a column of height, width, focal length.
    Source: https://github.com/Fyusion/LLFF. Departure: depths are the 0.1 and 99.9 percentiles of all points inside the
    image, not only of those matched there.

    Args:
        points: (P, 3) su.
    Returns:
        (n, 17)
    """
    rows = []
    for camera in cameras:
        right, down, forward, centre = scene_from_cam(camera)[:3].T
        size = np.array([camera.height, camera.width, (camera.fx + camera.fy) / 2])
        pixels, depths = camera.project(points)
        inside = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=1)
        seen = depths[inside] if inside.any() else np.linalg.norm(points - camera.centre, axis=1)
        matrix = np.stack([down, right, -forward, centre, size], axis=1)
        rows.append(np.concatenate([matrix.ravel(), np.percentile(seen, [0.1, 99.9])]))
    return np.array(rows)
