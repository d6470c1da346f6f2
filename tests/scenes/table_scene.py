# SPDX-License-Identifier: Apache-2.0
"""A table with a clamp and a plant in a room, as Gaussians and as ray-cast photos, in su of any pose and size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cotton3dg.core.scene import Camera, Gaussians
from scenes.splat_scenes import round_gaussians

LENGTH_CM, WIDTH_CM, THICKNESS_CM = 120.0, 60.0, 3.0
FOOT_CM = np.array([4.0, -3.0, 0.0])
TOP_CM, REACH_CM = 70.0, 18.0
BOLLS_CM = np.array([[4.0, -3.0, 67.5], [22.0 - 2.5, -3.0, 50.0], [4.0, 12.5, 40.0], [-11.5, -3.0, 35.0]])
BOLL_RADIUS_CM = 2.5
SECOND_CM = np.array([[-30.0, 50.0], [40.0, 120.0]])
"""Opposite corners of the second table."""
SHELL_CM = 0.36
"""Gaussians of 0.2 cm so far inside render as a ball of the full radius."""


@dataclass(frozen=True)
class Pose:
    """scene = (cm @ rotation.T + shift) / cm_per_su."""

    cm_per_su: float
    rotation: np.ndarray
    shift: np.ndarray

    def scene(self, points_cm: np.ndarray) -> np.ndarray:
        return (points_cm @ self.rotation.T + self.shift) / self.cm_per_su

    def cm(self, points: np.ndarray) -> np.ndarray:
        return (points * self.cm_per_su - self.shift) @ self.rotation


POSE = Pose(37.0, Rotation.from_euler("xyz", (100, 20, 30), degrees=True).as_matrix(), np.array([30.0, -80.0, 12.0]))


def orbit(
    n: int = 36, width: int = 480, height: int = 270, radius_cm: float = 130.0, pose: Pose = POSE
) -> list[Camera]:
    """Cameras around the table, 55 cm above it, the first towards +x, that look at the plant."""
    cameras = []
    for k in range(n):
        angle = 2 * np.pi * (k + 0.3) / n
        centre = np.array([radius_cm * np.cos(angle), radius_cm * np.sin(angle), 55.0 + 4 * np.sin(3 * angle)])
        forward = np.array([0, 0, 32.0]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        cam_from_cm = np.stack([right, np.cross(forward, right), forward])
        rotation = cam_from_cm @ pose.rotation.T
        shift = -rotation @ pose.scene(centre[None])[0]
        focal = 0.8 * width
        cameras.append(
            Camera(
                f"{k:06d}.jpg", width, height, focal, focal, width / 2, height / 2, np.column_stack([rotation, shift])
            )
        )
    return cameras


def photo(
    camera: Camera,
    pose: Pose = POSE,
    *,
    table: bool = True,
    length_cm: float = LENGTH_CM,
    box_from_cm: float | None = None,
    second: bool = False,
    border_cm: float = 0.0,
) -> np.ndarray:
    """(H, W, 3) uint8: a grained table top with dark side faces before a room of coloured tiles, four rays a pixel.

    Args:
        box_from_cm: a box 20 cm high and wider than the table stands on its end from this x on.
        second: a square table of the same height stands 20 cm beside the table.
        border_cm: width of a dull border along one long side of a bright table top.
    """
    step = (np.arange(2) + 0.5) / 2
    u = (np.arange(camera.width)[:, None] + step).ravel()
    v = (np.arange(camera.height)[:, None] + step).ravel()
    x, y = np.meshgrid((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    rays = np.stack([x, y, np.ones_like(x)], -1) @ camera.rotation @ pose.rotation
    eye = pose.cm(camera.centre[None])[0]
    # The room is a box of 5 x 5 x 2.4 m whose floor lies 75 cm below the table.
    low, high = np.array([-250.0, -250.0, -75.0]), np.array([250.0, 250.0, 165.0])
    with np.errstate(divide="ignore"):
        exits = np.where(rays > 0, (high - eye) / rays, (low - eye) / rays)
    wall, far = exits.argmin(-1), exits.min(-1)
    hit = eye + far[..., None] * rays
    tiles = np.floor(hit / 23.0 + 1e-6).astype(int)
    colour = 40 + ((tiles @ [73, 179, 283] + 31 * wall)[..., None] * [37, 61, 89]) % 150.0
    if table:
        half = np.array([length_cm / 2, WIDTH_CM / 2])
        with np.errstate(divide="ignore"):
            for z in (-THICKNESS_CM, 0.0):
                reach = (z - eye[2]) / rays[..., 2]
                at = eye[:2] + reach[..., None] * rays[..., :2]
                on = (reach > 0) & (np.abs(at) <= half).all(-1)
                grain = 150 + 12 * np.sin(at[..., 1] * 1.7 + np.sin(at[..., 0] * 0.4))
                if border_cm:
                    grain = np.where(at[..., 1] > half[1] - border_cm, 30, 250)
                colour[on] = grain[on, None] * [1.0, 0.8, 0.6] if z == 0 else 60.0
                if z < 0:
                    colour = _sides(colour, eye, rays, half)
    if second:
        _paint(colour, eye, rays, SECOND_CM, (0.0, 0.0), [120.0, 130.0, 150.0])
    if box_from_cm is not None:
        box = np.array([[box_from_cm, -36.0], [66.0, 36.0]])
        _paint(colour, eye, rays, box, (0.0, 20.0), [185.0, 150.0, 100.0])
    colour = colour.reshape(camera.height, 2, camera.width, 2, 3).mean((1, 3))
    return np.clip(colour, 0, 255).astype(np.uint8)


def _paint(
    colour: np.ndarray, eye: np.ndarray, rays: np.ndarray, box: np.ndarray, heights: tuple[float, float], tint: list
) -> None:
    """Paint an upright box that hides whatever was painted before; its lower rim lies on the table top's plane."""
    low, high = np.append(box[0], heights[0]), np.append(box[1], heights[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.sort([(low - eye) / rays, (high - eye) / rays], axis=0)
    enter, leave = at[0].max(-1), at[1].min(-1)
    hit = (enter <= leave) & (enter > 0)
    face = at[0].argmax(-1)[hit]
    colour[hit] = np.array(tint) * np.array([0.7, 0.55, 1.0])[face][:, None]


def _sides(colour: np.ndarray, eye: np.ndarray, rays: np.ndarray, half: np.ndarray) -> np.ndarray:
    for axis in (0, 1):
        for sign in (-1, 1):
            reach = (sign * half[axis] - eye[axis]) / rays[..., axis]
            at = eye + reach[..., None] * rays
            on = (reach > 0) & (sign * eye[axis] > half[axis]) & (np.abs(at[..., 1 - axis]) <= half[1 - axis])
            on &= (at[..., 2] <= 0) & (at[..., 2] >= -THICKNESS_CM)
            colour[on] = 70.0
    return colour


def table_points_cm(rng: np.random.Generator, n: int = 4000, noise_cm: float = 0.15) -> np.ndarray:
    """Noisy points of the table top, the clamp's two tubes, the floor, the walls and some in mid-air."""
    top = rng.uniform([-60, -30, 0], [60, 30, 0], (n, 3))
    tubes = rng.uniform([-16, -5, 0], [24, 4, 4], (n // 4, 3))
    tubes[::2, 2] = 4.0
    floor = rng.uniform([-240, -240, -75], [240, 240, -75], (12 * n, 3))
    floor = floor[(np.abs(floor[:, :2]) > [60, 30]).any(1)]
    walls = rng.uniform([-250, -250, -75], [250, -250, 165], (n, 3))
    air = rng.uniform([-80, -80, -20], [80, 80, 90], (n // 20, 3))
    points = np.concatenate([top, tubes, floor, walls, air])
    return points + rng.normal(0, noise_cm, points.shape)


def gaussians_at(
    points_cm: np.ndarray, sigma_cm: np.ndarray | float, pose: Pose = POSE, opacity: float = 0.9
) -> Gaussians:
    """Round Gaussians."""
    sizes = np.asarray(sigma_cm, float) / pose.cm_per_su
    return round_gaussians(pose.scene(points_cm), sizes, np.log(opacity / (1 - opacity)))


def joined(*parts: Gaussians) -> Gaussians:
    fields = ("means", "quats", "log_scales", "opacity_logits", "sh")
    return Gaussians(*(np.concatenate([getattr(part, field) for part in parts]) for field in fields))


def plant_points_cm(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points of stem (above the clamp), branches and bolls, and the boll of each, 1-based, 0 = none."""
    stem = FOOT_CM + np.linspace([0, 0, 4.5], [0, 0, 64.0], 240)
    parts, labels = [stem], [np.zeros(len(stem), int)]
    for number, centre in enumerate(BOLLS_CM, 1):
        start = FOOT_CM + [0, 0, centre[2] - 6]
        branch = np.linspace(start, centre, 60)
        # A gap of 2 cm, as thin branches have.
        along = np.linalg.norm(branch - start, axis=1)
        branch = branch[np.abs(along - 6) > 1] if along[-1] > 8 else branch
        direction = rng.normal(size=(400, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        parts += [branch, centre + (BOLL_RADIUS_CM - SHELL_CM) * direction]
        labels += [np.zeros(len(branch), int), np.full(400, number)]
    return np.concatenate(parts), np.concatenate(labels)


def plant_scene(seed: int = 0, pose: Pose = POSE) -> tuple[Gaussians, np.ndarray]:
    """Gaussians of the whole scene with floaters, and the boll of each."""
    rng = np.random.default_rng(seed)
    plant, labels = plant_points_cm(rng)
    floaters = rng.uniform([-50, -50, 8], [50, 50, 90], (60, 3))
    floaters = floaters[np.linalg.norm(floaters[:, :2] - FOOT_CM[:2], axis=1) > 24]
    room = table_points_cm(rng)
    label_sheet = rng.uniform([-40, 10, 0.1], [-28, 20, 0.1], (200, 3))
    scene = joined(
        gaussians_at(plant, 0.2, pose),
        gaussians_at(floaters, 0.5, pose, 0.4),
        gaussians_at(room, 0.3, pose),
        gaussians_at(label_sheet, 0.2, pose),
    )
    return scene, np.concatenate([labels, np.zeros(len(scene) - len(labels), int)])
