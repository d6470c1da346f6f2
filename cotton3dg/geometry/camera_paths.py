# SPDX-License-Identifier: Apache-2.0
"""Paths of a virtual camera: around the plant in an even circle, or along the walk of the real one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ..core.scene import Camera, Float64

SMOOTHING: Final = 2.0
"""Standard deviation in images: a hand shakes from one image to the next, a walk turns over many."""


def turntable(cameras: Sequence[Camera], target: Float64, up: Float64, count: int) -> list[Camera]:
    """An even circle around the axis `up` through `target`, looking at it, as high and as far as the cameras' medians.

    The first view is from the first camera's side; seen from above the circle goes counter-clockwise. It does not
    repeat its first view, so that a film of it can be looped.

    Args:
        target: (3,) su. up: (3,) unit vector.
    Returns:
        `count` cameras with the lens of the first of `cameras`.
    """
    away = np.stack([camera.centre for camera in cameras]) - target
    heights = away @ up
    level = away - np.outer(heights, up)
    distance, height = np.median(np.linalg.norm(level, axis=1)), np.median(heights)
    x = level[0] / max(float(np.linalg.norm(level[0])), 1e-12)
    y = np.cross(up, x)
    angles = 2 * np.pi * np.arange(count) / count
    centres = target + distance * (np.outer(np.cos(angles), x) + np.outer(np.sin(angles), y)) + height * up
    return [_pose(cameras[0], i, count, _look(centre, target, up), centre) for i, centre in enumerate(centres)]


def walk(cameras: Sequence[Camera], count: int) -> list[Camera]:
    """The cameras' own path from the first to the last, without the shake of a hand and at a steady speed.

    Centres and rotations are smoothed over neighbours by a Gaussian of `SMOOTHING` and joined by cubic splines.

    Returns:
        `count` cameras with the lens of the first of `cameras`.
    Raises:
        ValueError: fewer than two cameras.
    """
    from scipy.interpolate import CubicSpline
    from scipy.ndimage import gaussian_filter1d

    if len(cameras) < 2:
        raise ValueError(f"a path needs at least 2 cameras, got {len(cameras)}")
    poses = np.stack([np.append(camera.rotation.ravel(), camera.centre) for camera in cameras])
    poses = gaussian_filter1d(poses, SMOOTHING, axis=0, mode="nearest")
    travelled = np.append(0.0, np.linalg.norm(np.diff(poses[:, 9:], axis=0), axis=1).cumsum())
    times = np.interp(np.linspace(0.0, travelled[-1], count), travelled, np.arange(len(cameras)))
    sampled = CubicSpline(np.arange(len(cameras)), poses)(times)
    # A mean of rotations is not a rotation; the nearest one is its orthogonal part.
    u, _, v = np.linalg.svd(sampled[:, :9].reshape(-1, 3, 3))
    u[:, :, 2] *= np.linalg.det(u @ v)[:, None]
    return [_pose(cameras[0], i, count, r, c) for i, (r, c) in enumerate(zip(u @ v, sampled[:, 9:], strict=True))]


def reframe(camera: Camera, width: int, height: int) -> Camera:
    """The camera with an image of width x height px that shows the same from top to bottom: plants are tall."""
    factor = height / camera.height
    return replace(
        camera,
        width=width,
        height=height,
        fx=camera.fx * factor,
        fy=camera.fy * factor,
        cx=width / 2 + (camera.cx - camera.width / 2) * factor,
        cy=height / 2 + (camera.cy - camera.height / 2) * factor,
    )


def _look(centre: Float64, target: Float64, up: Float64) -> Float64:
    """(3, 3) rotation of a camera at `centre` that sees `target` in the middle of an upright image."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


def _pose(lens: Camera, i: int, count: int, rotation: Float64, centre: Float64) -> Camera:
    name = f"{i:0{max(3, len(str(count - 1)))}d}"
    return replace(lens, name=name, cam_from_scene=np.column_stack([rotation, -rotation @ centre]))
