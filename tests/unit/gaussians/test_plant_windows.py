# SPDX-License-Identifier: Apache-2.0
"""Where in the photos the plant is, from points of structure from motion."""

import numpy as np
from scenes.table_scene import POSE, orbit

from cotton3dg.core.scene import Camera
from cotton3dg.gaussians.plant_windows import find_plant_points, find_plant_windows
from cotton3dg.geometry.camera_orbit import fit_orbit
from cotton3dg.geometry.planes import level_planes, table_plane

WIDTH, HEIGHT = 960, 540


def cameras(count: int = 12) -> list[Camera]:
    return orbit(count, WIDTH, HEIGHT)


def scene(height_cm: float = 60, width_cm: float = 20, n_plant: int = 800) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) su points of a plant on a table in a room, and (N,) which are the plant's."""
    rng, half = np.random.default_rng(3), width_cm / 2
    plant = rng.uniform([-half, -half, 5], [half, half, height_cm], (n_plant, 3))
    table = rng.uniform([-60, -30, -0.1], [60, 30, 0.1], (3000, 3))
    angle, level = rng.uniform(0, 2 * np.pi, 3000), rng.uniform(-80, 150, 3000)
    walls = np.stack([300 * np.cos(angle), 300 * np.sin(angle), level], axis=1)
    stray = np.array([[50, 40, 140], [np.nan, 0, 0]])
    points = POSE.scene(np.concatenate([plant, table, walls, stray]))
    return points, np.arange(len(points)) < n_plant


def test_the_window_holds_the_plant_and_little_else() -> None:
    points, is_plant = scene()
    views = cameras()
    for camera, window in zip(views, find_plant_windows(points, views), strict=True):
        assert window is not None
        left, top, width, height = window
        pixels, _ = camera.project(points[is_plant])
        assert (pixels >= (left, top)).all()
        assert (pixels <= (left + width, top + height)).all()
        spread = np.ptp(pixels, axis=0)
        assert width < 1.5 * spread.max()
        assert width * height < 0.5 * WIDTH * HEIGHT
        assert left % 16 == top % 16 == 0


def test_table_room_and_strays_are_no_plant() -> None:
    points, is_plant = scene()
    found = find_plant_points(points, cameras())
    assert len(found) > 0.9 * is_plant.sum()
    places_cm = POSE.cm(found)
    assert places_cm[:, 2].min() > 2
    assert np.abs(places_cm[:, :2]).max() < 11


def test_a_dense_crown_is_no_table() -> None:
    # Leaves at all heights of a wide crown over a table of few points: many lie on some level plane through it.
    rng = np.random.default_rng(4)
    crown = rng.uniform([-36, -36, 45], [36, 36, 97], (3000, 3))
    stem = rng.uniform([-1, -1, 5], [1, 1, 45], (300, 3))
    table = rng.uniform([-60, -30, -0.1], [60, 30, 0.1], (250, 3))
    points, views = POSE.scene(np.concatenate([crown, stem, table])), cameras()
    assert len(level_planes(points, fit_orbit(views))) > 1
    found_cm = POSE.cm(find_plant_points(points, views))
    assert found_cm[:, 2].min() < 10
    assert len(found_cm) > 0.9 * 3300


def test_of_sparse_points_the_fullest_plane_is_the_table() -> None:
    rng = np.random.default_rng(5)
    crown = rng.uniform([-36, -36, 3], [36, 36, 97], (1500, 3))
    table = rng.uniform([-60, -30, -3], [60, 30, 3], (800, 3))  # too rough for a surface
    points, views = POSE.scene(np.concatenate([crown, table])), cameras()
    plane = table_plane(points, fit_orbit(views))
    assert plane is not None
    height_cm = POSE.cm(points)[:, 2][np.abs(points @ plane[:3] + plane[3]).argsort()[:100]]
    assert np.abs(height_cm).max() < 5


def test_without_a_table_or_a_plant_the_whole_image_counts() -> None:
    points, is_plant = scene()
    views = cameras(6)
    assert find_plant_windows(points[~is_plant][:3000], views) == [None] * 6
    assert find_plant_windows(np.random.default_rng(0).normal(size=(20, 3)), views) == [None] * 6


def test_a_plant_that_fills_the_image_has_no_window() -> None:
    points, _ = scene(height_cm=120, width_cm=140)
    views = cameras(6)
    assert find_plant_windows(points, views) == [None] * 6
