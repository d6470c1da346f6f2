# SPDX-License-Identifier: Apache-2.0
"""A ball of coloured blobs, filmed on a full turn: a small scene to train on, with a known answer."""

import numpy as np

from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians.metrics import psnr_db, to_uint8
from cotton3dg.gaussians.rasterizer import render
from cotton3dg.gaussians.views import View
from cotton3dg.options import TrainOptions
from cotton3dg.train.initialise import place_gaussians

OPTIONS = TrainOptions(steps=300, max_gaussians=400, sh_degree=0)


def orbit_camera(angle: float, width: int = 64, height: int = 48) -> Camera:
    centre = 4 * np.array([np.cos(angle), np.sin(angle), 0.3])
    forward = -centre / np.linalg.norm(centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.column_stack([rotation, -rotation @ centre])
    return Camera(f"{angle:.3f}", width, height, width, width, width / 2, height / 2, pose)


def truth() -> Gaussians:
    """300 opaque coloured blobs in a ball of radius 1."""
    rng = np.random.default_rng(7)
    points = rng.normal(size=(300, 3))
    points *= rng.uniform(0.2, 1.0, (300, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    gaussians = place_gaussians(points, rng.integers(0, 256, (300, 3)).astype(np.uint8), 0, 300, 0)
    gaussians.opacity_logits[:] = 2.0
    gaussians.log_scales[:] = np.log(rng.uniform(0.05, 0.12, (300, 3)))
    return gaussians


def training_scene(n_views: int = 12) -> tuple[Gaussians, list[View], View]:
    """A poor start (half of the points, displaced, grey), training views and a held-out one."""
    model, rng = truth(), np.random.default_rng(8)
    views = []
    for angle in [*np.linspace(0, 2 * np.pi, n_views, endpoint=False), 0.2]:
        camera = orbit_camera(angle)
        views.append(View(camera, to_uint8(render(model, camera).image)))
    points = model.means[::2] + rng.normal(0, 0.03, (150, 3))
    return place_gaussians(points, np.full((150, 3), 128, np.uint8), 0, 400, 0), views[:-1], views[-1]


def quality_db(gaussians: Gaussians, view: View) -> float:
    return psnr_db(to_uint8(render(gaussians, view.camera).image), view.image)
