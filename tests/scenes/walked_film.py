# SPDX-License-Identifier: Apache-2.0
"""A plant of five bolls and the cameras of a walk around it, as a first look at a film would find them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cotton3dg.capture_check.first_count import find_bolls_in_space
from cotton3dg.capture_check.preview import Look
from cotton3dg.capture_check.view_detections import Sight
from cotton3dg.core.measurements import Scale
from cotton3dg.core.runs import StageOutcome
from cotton3dg.core.scene import Camera
from cotton3dg.geometry.camera_orbit import fit_orbit
from cotton3dg.scale.estimate_scale import FoundScale
from cotton3dg.schemas.scale import ScaleInfo
from scenes.documents import frame_info, frames_info

WIDTH, HEIGHT, FOCAL_PX, RADIUS = 640, 360, 525.0, 1.4
BOLLS = np.array([[0.0, 0.0, 0.5], [0.12, 0.02, 0.42], [-0.1, 0.08, 0.3], [0.05, -0.13, 0.22], [0.02, 0.05, 0.36]])
DIAMETER = 0.04


def camera_at(azimuth_deg: float, aim: float = 0.3, name: str = "") -> Camera:
    """A camera of the orbit, level with the plant's middle, that looks at a height above the table (m)."""
    a = np.radians(azimuth_deg)
    centre, target = np.array([RADIUS * np.cos(a), RADIUS * np.sin(a), 0.5]), np.array([0, 0, aim])
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.column_stack([rotation, -rotation @ centre])
    return Camera(name or f"{azimuth_deg:03.0f}.jpg", WIDTH, HEIGHT, FOCAL_PX, FOCAL_PX, WIDTH / 2, HEIGHT / 2, pose)


def sight_of(camera: Camera, bolls: np.ndarray = BOLLS, plant: np.ndarray | None = None) -> Sight:
    """What a network without faults says of bolls that hide nothing from each other."""
    pixels, depths = camera.project(bolls)
    parts = np.zeros((HEIGHT // 2, WIDTH // 2), np.int32) if plant is None else plant
    sizes = camera.fx * DIAMETER / depths
    return Sight(camera, np.zeros((HEIGHT, WIDTH), np.uint16), pixels, sizes, 0.7, 0.0, parts)


def look_of(cameras: list[Camera], **changes) -> Look:
    """A first look at a film without faults."""
    sights = [sight_of(camera) for camera in cameras]
    orbit = fit_orbit(cameras)
    corners = np.array([[-0.6, -0.3, 0], [0.6, -0.3, 0], [0.6, 0.3, 0], [-0.6, 0.3, 0]])
    scale = Scale(100.0, 0.002, "table", np.array([0, 0, 1.0]), np.array([0, 0, 1.0, 0]), corners)
    images = tuple(frame_info(camera.name) for camera in cameras)
    found = Look(
        frames=frames_info(list(images)),
        names=tuple(camera.name for camera in cameras),
        images=Path(),
        cameras=cameras,
        orbit=orbit,
        sights=sights,
        bolls=find_bolls_in_space(sights, orbit),
        scale=FoundScale(ScaleInfo.of_scale(scale), StageOutcome()),
    )
    return replace(found, **changes)


def walked() -> list[Camera]:
    """Cameras of a full turn, 15 degrees apart."""
    return [camera_at(azimuth) for azimuth in range(0, 360, 15)]
