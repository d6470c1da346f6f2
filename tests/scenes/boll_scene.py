# SPDX-License-Identifier: Apache-2.0
"""Five bolls on a stem, made of Gaussians, and twelve cameras around it; rendered to exact masks."""

from pathlib import Path

import numpy as np

from cotton3dg.core.network_maps import Maps
from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians.rasterizer import render_values
from cotton3dg.io.images import write_ids
from cotton3dg.io.ply import write_gaussians
from cotton3dg.workspace import Workspace
from scenes.splat_scenes import round_gaussians

CENTRES = np.array([[0, 0, 3.0], [0.5, 0, 2.0], [-0.35, 0.35, 1.5], [0.05, 0.55, 1.45], [0, -0.6, 1.0]])
"""The third and fourth touch."""
RADIUS = 0.22
N_VIEWS = 12


def model() -> tuple[Gaussians, np.ndarray]:
    """Gaussians and the boll of each, 0 = stem."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(5, 160, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    stem = np.column_stack([rng.normal(0, 0.02, (300, 2)), rng.uniform(0, 2.7, 300)])
    means = np.concatenate([(CENTRES[:, None] + RADIUS * directions).reshape(-1, 3), stem])
    return round_gaussians(means, 0.035), np.concatenate([np.repeat(np.arange(1, 6), 160), np.zeros(300, int)])


def cameras() -> list[Camera]:
    views = []
    for i in range(N_VIEWS):
        angle = 2 * np.pi * i / N_VIEWS
        centre = np.array([6 * np.cos(angle), 6 * np.sin(angle), 2.5])
        forward = np.array([0, 0, 1.7]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0]) / np.linalg.norm(np.cross(forward, [0, 0, 1.0]))
        rotation = np.stack([right, np.cross(forward, right), forward])
        pose = np.column_stack([rotation, -rotation @ centre])
        views.append(Camera(f"{i:06d}.jpg", 240, 200, 260.0, 260.0, 120.0, 100.0, pose))
    return views


def write_model(folder: Path, views: list[Camera]) -> None:
    import pycolmap

    model = pycolmap.Reconstruction()
    first = views[0]
    intrinsics = [first.fx, first.fy, first.cx, first.cy]
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(model="PINHOLE", width=first.width, height=first.height, params=intrinsics, camera_id=1)
    )
    for i, view in enumerate(views, 1):
        image = pycolmap.Image(name=view.name, camera_id=1, image_id=i)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(view.cam_from_scene))
    folder.mkdir(parents=True)
    model.write_binary(str(folder))


def write_masks(workspace: Workspace, ids: list[np.ndarray]) -> None:
    with workspace.writing("masks") as folder:
        for view, image in zip(cameras(), ids, strict=True):
            write_ids(folder / workspace.mask_png(view.name).name, image)


def masks_of(gaussians: Gaussians, bolls: np.ndarray, views: list[Camera]) -> list[np.ndarray]:
    """Exact ids of the bolls, 0 = background; the same number is the same boll in every view."""
    shares = np.eye(6, dtype=np.float32)[bolls]
    images = [render_values(gaussians, view, shares).image for view in views]
    return [np.where(image.sum(axis=2) > 0.5, image.argmax(axis=2), 0).astype(np.uint16) for image in images]


def made_workspace(folder: Path) -> Workspace:
    """Model and masks; no ids agree between views, and one view misses every boll."""
    workspace = Workspace(folder)
    gaussians, bolls = model()
    write_model(workspace.undistorted / "sparse", cameras())
    with workspace.writing("train") as train:
        write_gaussians(train / workspace.gaussians_ply.name, gaussians)
    ids = []
    for i, name in enumerate(masks_of(gaussians, bolls, cameras())):
        ids.append(np.where(name > 0, (name * 7 + i) % 5 + 1 + i, 0).astype(np.uint16))
    ids[4] = np.zeros_like(ids[4])
    write_masks(workspace, ids)
    return workspace


def maps_of(camera, ids: np.ndarray, rng: np.random.Generator, noise: float = 0.0) -> Maps:
    """What the network should say of an image of the scene, at the size of the image; `noise` in diameters."""
    pixels, depths = camera.project(CENTRES)
    size = np.concatenate([[1.0], 2 * RADIUS * camera.fx / depths])
    table = np.concatenate([[[0.0, 0.0]], pixels])
    lint = np.where(ids > 0, 0.9, 0.05)
    probabilities = np.zeros((5, *ids.shape), np.float32)
    probabilities[1], probabilities[0] = lint, 1 - lint
    votes = table[ids] + noise * size[ids][..., None] * rng.normal(size=(*ids.shape, 2))
    return Maps(
        probabilities,
        votes.transpose(2, 0, 1).astype(np.float32),
        size[ids].astype(np.float32),
        1.0,
        ids.shape,
    )


def photos_of(images: list[np.ndarray]) -> list[np.ndarray]:
    """Photos of the scene: bright bolls before a dark ground."""
    return [np.repeat(np.where(ids > 0, 230, 60).astype(np.uint8)[..., None], 3, axis=2) for ids in images]


class Speaking:
    """A network that says of each image what it was told to."""

    def __init__(self, maps):
        self.waiting = iter(maps)

    def maps(self, image, look=1.0, window=None):
        return next(self.waiting)
