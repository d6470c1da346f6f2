# SPDX-License-Identifier: Apache-2.0
"""What is true of a plant's filming, in the scene that structure from motion made of it."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cotton3dg.core.measurements import Scale
from cotton3dg.core.scene import Camera
from cotton3dg.io.annotations import undistort_ids
from cotton3dg.io.colmap import read_tracks
from cotton3dg.io.images import read_ids
from cotton3dg.schemas.frames import FramesInfo
from cotton3dg.workspace import Workspace

CM_PER_M = 100.0
LEAST_VIEWS = 3
LEAST_POINTS = 50
FAR_CM = 100.0
"""Farther from the middle of the table points say little about the scale at the plant; `LEAST_POINTS` are taken anyway,
for in a small image a table may show fewer."""


class TruePlant(NamedTuple):
    """A finished workspace and the folder with `truth.json`, `cameras.json` and `instances/` of what it shows."""

    run: Workspace
    truth: Path


def true_plant(text: str) -> TruePlant:
    """RUN, or RUN:TRUTH when the truth lies elsewhere."""
    run, _, truth = text.partition(":")
    return TruePlant(Workspace(run), Path(truth or run))


def source_indices(plant: Workspace) -> dict[str, int]:
    """Name of each image -> its number in the video."""
    return {image.name: image.source_index for image in FramesInfo.load(plant.frames_json).images}


def true_cameras(plant: TruePlant) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Image name -> (3, 4) pose of the camera, from the true world in cm; and the lens as cameras.json describes it."""
    lens = json.loads((plant.truth / "cameras.json").read_text(encoding="utf-8"))
    worlds = {frame["frame"]: np.array(frame["camera_to_world"])[:3] for frame in lens["frames"]}
    poses = {}
    for name, index in source_indices(plant.run).items():
        rotation = worlds[index][:, :3].T
        poses[name] = np.column_stack([rotation, -rotation @ worlds[index][:, 3] * CM_PER_M])
    return poses, lens


def true_masks(plant: TruePlant, cameras: list[Camera]) -> dict[str, np.ndarray]:
    """Image name -> true ids at the size of the undistorted image, of those cameras that have some."""
    folder, indices = plant.truth / "instances", source_indices(plant.run)
    files = [(camera, folder / f"frame_{indices[camera.name]:04d}.png") for camera in cameras]
    return {
        camera.name: undistort_ids(Path(camera.name).stem, read_ids(path), camera, plant.run.sfm_model)
        for camera, path in files
        if path.is_file()
    }


def true_bolls_cm(plant: TruePlant) -> np.ndarray:
    """(B, 3) centres in the true world."""
    bolls = json.loads((plant.truth / "truth.json").read_text(encoding="utf-8"))["bolls"]
    return CM_PER_M * np.array([boll["centre_xyz_m"] for boll in bolls])


@cache
def true_points(plant: TruePlant) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The points of structure from motion where the true cameras see them.

    Returns:
        ids (P,) in the model of the images as filmed; (P, 3) su as structure from motion has them; (P, 3) cm in the
        true world, triangulated from the same observations; points that err by more than three times the median of
        the distance from their rays are left out.
    """
    import cv2
    import pycolmap

    model = pycolmap.Reconstruction(plant.run.sfm_model)
    poses, lens = true_cameras(plant)
    (filmed,) = model.cameras.values()
    zoom = filmed.width / lens["width"]
    matrix = np.array([[lens["fx"], 0, lens["cx"]], [0, lens["fy"], lens["cy"]], [0, 0, 1 / zoom]]) * zoom
    distortion = np.array([lens["distortion"][key] for key in ("k1", "k2", "p1", "p2")])
    ids, origins, rays = [], [], []
    for name, (places, points) in read_tracks(plant.run.sfm_model).items():
        rotation, shift = poses[name][:, :3], poses[name][:, 3]
        xy = cv2.undistortPoints(places[:, None], matrix, distortion)[:, 0]
        ray = np.column_stack([xy, np.ones(len(xy))]) @ rotation
        ids.append(points)
        rays.append(ray / np.linalg.norm(ray, axis=1, keepdims=True))
        origins.append(np.broadcast_to(-rotation.T @ shift, ray.shape))
    names, row = np.unique(np.concatenate(ids), return_inverse=True)
    ray, origin = np.concatenate(rays), np.concatenate(origins)
    # Nearest point to all rays: sum of (I - d d') (x - c) = 0.
    across = np.eye(3) - ray[:, :, None] * ray[:, None]
    normal, right = np.zeros((len(names), 3, 3)), np.zeros((len(names), 3))
    np.add.at(normal, row, across)
    np.add.at(right, row, np.einsum("nij,nj->ni", across, origin))
    counts = np.bincount(row)
    firm = (counts >= LEAST_VIEWS) & (np.linalg.eigvalsh(normal)[:, 0] > 1e-3 * counts)
    xyz = np.full((len(names), 3), np.nan)
    xyz[firm] = np.linalg.solve(normal[firm], right[firm][..., None])[..., 0]
    gaps = np.linalg.norm(np.einsum("nij,nj->ni", across, xyz[row] - origin), axis=1)
    error = np.bincount(row, gaps, len(names)) / counts
    kept = error <= 3 * np.nanmedian(error)
    scene = np.array([model.points3D[int(point)].xyz for point in names])
    return names[kept], scene[kept], xyz[kept]


@cache
def cm_from_scene(plant: TruePlant) -> np.ndarray:
    """(3, 4) similarity that lays the points around the plant over the true ones.

    Points and not cameras: a focal length that is a little wrong moves all cameras away from the plant or towards it,
    by 2 % of their distance in some plants, and hardly changes the scale at the plant.
    """
    _, scene, true = true_points(plant)
    distances = np.linalg.norm(true, axis=1)
    near = distances <= max(FAR_CM, np.sort(distances)[:LEAST_POINTS][-1])
    scene, true = scene[near], true[near]
    kept = np.ones(len(true), bool)
    for _ in range(5):
        similarity = _similarity(scene[kept], true[kept])
        gaps = np.linalg.norm(scene @ similarity[:, :3].T + similarity[:, 3] - true, axis=1)
        kept = gaps <= 3 * np.median(gaps)
    return similarity


def true_scale(plant: TruePlant) -> Scale:
    """Scale, plane and corners of the table as they truly are.

    Raises:
        KeyError, TypeError: the truth has no table.
    """
    table = json.loads((plant.truth / "truth.json").read_text(encoding="utf-8"))["table"]
    half = np.array([table["length_cm"], table["width_cm"], 0.0]) / 2
    corners_cm = half * [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    similarity = cm_from_scene(plant)
    cm_per_su = float(np.cbrt(np.linalg.det(similarity[:, :3])))
    rotation = similarity[:, :3] / cm_per_su
    corners = (corners_cm - similarity[:, 3]) @ rotation / cm_per_su
    up = rotation[2]
    return Scale(cm_per_su, 0.0, "truth", up, np.append(up, -up @ corners[0]), corners)


def _similarity(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(3, 4) least-squares similarity from (N, 3) source to target points (Umeyama 1991)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, values, v = np.linalg.svd(b.T @ a)
    flip = np.array([1, 1, np.linalg.det(u @ v)])
    scaled = u * flip @ v * ((values * flip).sum() / (a * a).sum())
    return np.column_stack([scaled, target.mean(axis=0) - scaled @ source.mean(axis=0)])
