# SPDX-License-Identifier: Apache-2.0
"""White balls on a table in a room with a white wall, posters and a sheet of paper, ray-cast with exact ids; in m."""

from __future__ import annotations

import numpy as np

from cotton3dg.core.scene import Camera, Gaussians
from scenes.splat_scenes import round_gaussians

BOLLS = np.array(
    [
        [0.0, 0.0, 0.62],
        [0.14, 0.02, 0.45],
        [-0.12, 0.1, 0.38],
        [0.02, -0.15, 0.3],
        [0.055, -0.115, 0.345],
        [-0.1, -0.1, 0.5],
    ]
)
"""(6, 3) centres; the fourth and fifth nearly touch and hide each other in many views."""
RADIUS = 0.028
PAPER = np.array([[0.15, 0.3], [0.08, 0.18]])
"""x and y range of a sheet on the table."""
WIDTH, HEIGHT, FOCAL = 480, 270, 400.0
WALL_M = 3.0


def orbit_cameras(n: int, *, radius: float = 1.3, turn: float = 2 * np.pi) -> list[Camera]:
    """Cameras around the plant that bob up and down a little."""
    cameras = []
    for k in range(n):
        angle = turn * k / n
        centre = np.array([radius * np.cos(angle), radius * np.sin(angle), 0.55 + 0.03 * np.sin(3 * angle)])
        forward = np.array([0, 0, 0.36]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0]) / np.linalg.norm(np.cross(forward, [0, 0, 1.0]))
        rotation = np.stack([right, np.cross(forward, right), forward])
        pose = np.column_stack([rotation, -rotation @ centre])
        cameras.append(Camera(f"{k:06d}.jpg", WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, pose))
    return cameras


def photo(camera: Camera, *, bolls: np.ndarray = BOLLS, exposure: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) RGB and (H, W) ids, 1-based, of one view."""
    rng = np.random.default_rng(int(camera.name[:-4]))
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], -1) @ camera.rotation
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    origin = camera.centre
    colour, ids = _room(origin, rays), np.zeros(x.shape, np.uint16)

    depth = np.where(rays[..., 2] < 0, -origin[2] / np.minimum(rays[..., 2], -1e-9), np.inf)
    hit = origin + np.where(np.isfinite(depth), depth, 0)[..., None] * rays
    table = np.isfinite(depth) & (np.abs(hit[..., 0]) < 0.6) & (np.abs(hit[..., 1]) < 0.3)
    colour[table] = (0.45, 0.3, 0.18)
    inside = [(hit[..., k] > PAPER[k, 0]) & (hit[..., k] < PAPER[k, 1]) for k in (0, 1)]
    colour[table & inside[0] & inside[1]] = 0.85
    depth[~table] = np.inf

    for number, centre in enumerate(bolls, start=1):
        away = origin - centre
        half = (rays * away).sum(-1)
        root = half**2 - (away @ away - RADIUS**2)
        distance = -half - np.sqrt(np.maximum(root, 0))
        front = (root > 0) & (distance < depth)
        normal = (origin + distance[..., None] * rays - centre) / RADIUS
        colour[front] = (np.array([0.9, 0.88, 0.84]) * (0.72 + 0.25 * normal[..., 2:]))[front]
        depth[front], ids[front] = distance[front], number
    stem = np.abs(rays[..., 0] * origin[1] - rays[..., 1] * origin[0]) / np.hypot(rays[..., 0], rays[..., 1]) < 0.008
    height = origin[2] + rays[..., 2] * np.hypot(*origin[:2]) / np.hypot(rays[..., 0], rays[..., 1])
    stem &= (height > 0) & (height < 0.6) & (depth > np.hypot(*origin[:2]))
    colour[stem], ids[stem] = (0.25, 0.17, 0.1), 0
    noisy = np.clip(colour * exposure, 0, 1) ** (1 / 2.2) * 255 + rng.normal(0, 2, colour.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8), ids


def _room(origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Colours of a round wall, a quarter of it nearly white, the rest brick red with white posters."""
    flat = rays[..., :2]
    half, square = flat @ origin[:2], (flat**2).sum(-1)
    distance = (-half + np.sqrt(half**2 + square * (WALL_M**2 - origin[:2] @ origin[:2]))) / square
    hit = origin + distance[..., None] * rays
    angle = np.mod(np.arctan2(hit[..., 1], hit[..., 0]), 2 * np.pi)
    colour = np.tile(np.array([0.35, 0.12, 0.08]), (*angle.shape, 1))
    colour[angle < np.pi / 2] = 0.55
    rng = np.random.default_rng(1)
    for start, low in zip(rng.uniform(0, 6, 14), rng.uniform(-0.3, 1.2, 14), strict=True):
        colour[(angle > start) & (angle < start + 0.25) & (hit[..., 2] > low) & (hit[..., 2] < low + 0.5)] = 0.8
    colour[hit[..., 2] < -0.7] = 0.15
    return colour


def table_points(n: int = 4000) -> np.ndarray:
    """(n, 3) points on the table top."""
    rng = np.random.default_rng(0)
    return np.column_stack([rng.uniform(-0.6, 0.6, n), rng.uniform(-0.3, 0.3, n), rng.normal(0, 0.001, n)])


def room_model() -> Gaussians:
    """Bolls, stem, table and wall, densely covered by opaque Gaussians."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(len(BOLLS), 600, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    stem = np.column_stack([rng.normal(0, 0.004, (1500, 2)), rng.uniform(0, 0.6, 1500)])
    angles, heights = rng.uniform(0, 2 * np.pi, 6000), rng.uniform(-1.5, 2.5, 6000)
    wall = np.column_stack([WALL_M * np.cos(angles), WALL_M * np.sin(angles), heights])
    parts = [((BOLLS[:, None] + 0.9 * RADIUS * directions).reshape(-1, 3), 0.002), (stem, 0.003)]
    parts += [(table_points(), 0.012), (wall, 0.08)]
    means = np.concatenate([points for points, _ in parts])
    return round_gaussians(means, np.concatenate([np.full(len(points), size) for points, size in parts]), 4.0)
