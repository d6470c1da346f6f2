# SPDX-License-Identifier: Apache-2.0
"""A toy plant with known bolls, seen by orbiting cameras: z-buffered weights and degraded masks, without a renderer.

Each Gaussian is drawn as a disc. The nearest one takes 0.8 of a pixel's weight and the next one the rest, which is
about what a trained model does on opaque surfaces.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from cotton3dg.core.scene import Camera

WIDTH, HEIGHT, FOCAL = 480, 270, 400.0


@dataclass(frozen=True)
class Scene:
    means: np.ndarray
    """(N, 3) su."""
    bolls: np.ndarray
    """(N,) 1-based boll of each Gaussian, 0 = none."""
    centres: np.ndarray
    """(B, 3) su."""
    touching: tuple[tuple[int, int], ...]
    """Pairs of touching bolls, 1-based."""


@dataclass(frozen=True)
class Weights:
    """What `gaussians.rasterizer.accumulate_weights` returns for one view."""

    total: np.ndarray
    rows: np.ndarray
    ids: np.ndarray
    weights: np.ndarray


def make_scene(seed: int, n_bolls: int = 24, points_per_boll: int = 250) -> Scene:
    """Bolls of 3.4 to 5.6 (a unit is 1 cm) on a stem; half of them touch another one, five crowd at the top."""
    rng = np.random.default_rng(seed)
    radii = rng.uniform(1.7, 2.8, n_bolls)
    centres: list[np.ndarray] = []
    touching: list[tuple[int, int]] = []
    for boll in range(n_bolls):
        crowd = boll < 5
        partner = boll - 1 if (boll % 2 if not crowd else boll > 0) else None
        for _ in range(10_000):
            if partner is None:
                height, angle = (58.0, 0.0) if crowd else (rng.uniform(18, 55), rng.uniform(0, 2 * np.pi))
                reach = 1.0 if crowd else rng.uniform(4, 17)
                centre = np.array([reach * np.cos(angle), reach * np.sin(angle), height])
            else:
                direction = rng.normal(size=3)
                step = (radii[boll] + radii[partner]) * rng.uniform(0.88, 1.0)
                centre = centres[partner] + direction / np.linalg.norm(direction) * step
            gaps = [np.linalg.norm(centre - c) / (radii[boll] + r) for c, r in zip(centres, radii, strict=False)]
            if all(gap > (0.85 if j == partner or crowd else 1.25) for j, gap in enumerate(gaps)):
                break
        touching += [(j + 1, boll + 1) for j, gap in enumerate(gaps) if gap < 1.02]
        centres.append(centre)
    parts, labels = [], []
    for boll, (centre, radius) in enumerate(zip(centres, radii, strict=True), 1):
        direction = rng.normal(size=(points_per_boll, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        lobes = 1 + 0.12 * np.cos(4 * np.arctan2(direction[:, 1], direction[:, 0]))
        shell = radius * lobes * rng.normal(0.97, 0.04, points_per_boll)
        parts.append(centre + direction * shell[:, None])
        labels.append(np.full(points_per_boll, boll))
    stem = np.stack([rng.normal(0, 0.4, 900), rng.normal(0, 0.4, 900), rng.uniform(0, 56, 900)], 1)
    table = np.stack([rng.uniform(-60, 60, 3000), rng.uniform(-30, 30, 3000), rng.normal(0, 0.1, 3000)], 1)
    branches = [
        np.linspace([0, 0, centre[2] - 8], centre - [0, 0, radius], 120)
        for centre, radius in zip(centres, radii, strict=True)
    ]
    for extra in [stem, table, *branches]:
        parts.append(extra)
        labels.append(np.zeros(len(extra), int))
    return Scene(np.concatenate(parts).astype(np.float32), np.concatenate(labels), np.array(centres), tuple(touching))


def orbit(n_views: int, radius: float = 110.0, height: float = 60.0) -> list[Camera]:
    """Cameras around the z axis that look at (0, 0, 35)."""
    cameras = []
    for view in range(n_views):
        angle = 2 * np.pi * view / n_views
        centre = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
        forward = np.array([0, 0, 35.0]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        pose = np.concatenate([rotation, (-rotation @ centre)[:, None]], axis=1)
        size = (FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2)
        cameras.append(Camera(f"{view:06d}.jpg", WIDTH, HEIGHT, *size, pose))
    return cameras


def layers(scene: Scene, camera: Camera, radius_su: float = 0.55) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) index of the nearest and of the second Gaussian at each pixel, -1 = none."""
    pixels, depths = camera.project(scene.means)
    reach = int(np.ceil(radius_su * FOCAL / np.min(depths)))
    dx, dy = (grid.ravel() for grid in np.meshgrid(*[np.arange(-reach, reach + 1)] * 2))
    x = np.floor(pixels[:, 0]).astype(int)[:, None] + dx
    y = np.floor(pixels[:, 1]).astype(int)[:, None] + dy
    near = (x + 0.5 - pixels[:, :1]) ** 2 + (y + 0.5 - pixels[:, 1:]) ** 2 < (radius_su * FOCAL / depths[:, None]) ** 2
    near &= (x >= 0) & (x < WIDTH) & (y >= 0) & (y < HEIGHT)
    row, _ = np.nonzero(near)
    place = (y * WIDTH + x)[near]
    order = np.lexsort((row, depths[row], place))
    place, row = place[order], row[order]
    first = np.flatnonzero(np.diff(place, prepend=-1))
    second = first + 1
    second = second[(second < len(place)) & (place[np.minimum(second, len(place) - 1)] == place[second - 1])]
    nearest, next_one = np.full((2, WIDTH * HEIGHT), -1)
    nearest[place[first]] = row[first]
    next_one[place[second]] = row[second]
    return nearest.reshape(HEIGHT, WIDTH), next_one.reshape(HEIGHT, WIDTH)


def weights_of(n: int, nearest: np.ndarray, next_one: np.ndarray, ids: np.ndarray) -> Weights:
    """Blending weights per Gaussian, in total and per mask."""
    rows = np.concatenate([nearest.ravel(), next_one.ravel()])
    shares = np.repeat([0.8, 0.2], nearest.size)
    masks = np.concatenate([ids.ravel()] * 2).astype(np.int64)
    hit = rows >= 0
    total = np.bincount(rows[hit], shares[hit], n)
    hit &= masks > 0
    keys, inverse = np.unique(rows[hit] * 65536 + masks[hit], return_inverse=True)
    weights = np.bincount(inverse, shares[hit], len(keys))
    return Weights(
        total.astype(np.float32), keys // 65536, (keys % 65536).astype(np.uint16), weights.astype(np.float32)
    )


def exact_masks(scene: Scene, nearest: np.ndarray) -> np.ndarray:
    """(H, W) uint16 boll ids of what is seen; slivers below 12 px are nobody's."""
    ids = np.where(nearest >= 0, scene.bolls[nearest], 0)
    sizes = np.bincount(ids.ravel(), minlength=scene.bolls.max() + 1)
    return np.where(sizes[ids] >= 12, ids, 0).astype(np.uint16)


def degraded_masks(
    touching: Iterable[tuple[int, int]],
    ids: np.ndarray,
    rng: np.random.Generator,
    *,
    missed: float = 0.15,
    merged: float = 0.3,
    split: float = 0.05,
    always_merged: tuple[tuple[int, int], ...] = (),
) -> np.ndarray:
    """Masks as a detector makes them: some missed, some split, edges 1 px off, ids shuffled, and of the pairs of bolls
    in `touching` some merged where they touch in the image."""
    import cv2

    ids = ids.astype(np.int32)
    parts = [ids == i for i in np.unique(ids) if i > 0]
    names = {int(i): k for k, i in enumerate(i for i in np.unique(ids) if i > 0)}
    kernel = np.ones((3, 3), np.uint8)
    for a, b in touching:
        if a not in names or b not in names or names[a] == names[b]:
            continue
        here, there = parts[names[a]], parts[names[b]]
        if not (cv2.dilate(here.astype(np.uint8), kernel) & there).any():
            continue
        if (a, b) in always_merged or rng.random() < merged:
            parts[names[a]] = here | there
            parts[names[b]] = np.zeros_like(there)
            gone = names[b]
            names = {name: names[a] if part == gone else part for name, part in names.items()}
    made = []
    for part in parts:
        if not part.any() or rng.random() < missed:
            continue
        noisy = (cv2.dilate if rng.random() < 0.5 else cv2.erode)(part.astype(np.uint8), kernel) > 0
        if rng.random() < split:
            y, x = np.nonzero(noisy)
            angle = rng.uniform(0, np.pi)
            side = (x - x.mean()) * np.cos(angle) + (y - y.mean()) * np.sin(angle) > 0 if len(x) else np.zeros(0, bool)
            half = np.zeros_like(noisy)
            half[y[side], x[side]] = True
            made.append(half)
            noisy = noisy & ~half
        made.append(noisy)
    result = np.zeros(ids.shape, np.uint16)
    for name, index in enumerate(rng.permutation(len(made)), 1):
        result[made[index] & (result == 0)] = name
    return result


def f1_at_half(scene: Scene, labels: np.ndarray, visible: np.ndarray) -> float:
    """F1 of bolls matched at 3D IoU (over the Gaussians that any view sees) of at least 0.5."""
    both = np.zeros((scene.bolls.max() + 1, int(labels.max()) + 1))
    np.add.at(both, (scene.bolls[visible], labels[visible]), 1)
    either = both.sum(0, keepdims=True) + both.sum(1, keepdims=True) - both
    hits = (both / np.maximum(either, 1))[1:, 1:] >= 0.5
    return 2 * float(hits.sum()) / (len(hits) + hits.shape[1])
