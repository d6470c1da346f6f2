# SPDX-License-Identifier: Apache-2.0
"""Cameras: from pixels to rays, and back."""

import numpy as np
from scenes.splat_scenes import camera_at


def test_what_lies_on_a_ray_projects_to_its_pixel() -> None:
    camera = camera_at(40, 30, angle=0.7)
    pixels = np.array([[[0.5, 0.5], [12.0, 7.25]], [[39.5, 29.5], [20.0, 15.0]]])
    rays, depths = camera.rays(pixels), np.array([0.5, 3.0, 7.0, 2.0])
    assert rays.shape == (2, 2, 3)
    assert (rays[..., 2] == 1).all()
    places = (rays.reshape(-1, 3) * depths[:, None] - camera.cam_from_scene[:, 3]) @ camera.rotation
    seen_at, seen_depths = camera.project(places)
    np.testing.assert_allclose(seen_at, pixels.reshape(-1, 2))
    np.testing.assert_allclose(seen_depths, depths)
