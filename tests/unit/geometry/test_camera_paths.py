# SPDX-License-Identifier: Apache-2.0
"""Paths of a virtual camera around a made table."""

from dataclasses import replace

import numpy as np
import pytest
from scenes.table_scene import POSE, orbit
from scipy.spatial.transform import Rotation

from cotton3dg.geometry.camera_paths import reframe, turntable, walk

UP = POSE.rotation[:, 2]
TARGET = POSE.scene(np.array([[3.0, -2.0, 35.0]]))[0]


def centres_cm(cameras) -> np.ndarray:
    return POSE.cm(np.stack([camera.centre for camera in cameras]))


def shaken(cameras, seed: int, cm: float, degrees: float):
    """The cameras as a hand holds them."""
    rng = np.random.default_rng(seed)
    made = []
    for camera in cameras:
        rotation = Rotation.from_rotvec(rng.normal(0, degrees, 3), degrees=True).as_matrix() @ camera.rotation
        centre = camera.centre + rng.normal(0, cm, 3) / POSE.cm_per_su
        made.append(replace(camera, cam_from_scene=np.column_stack([rotation, -rotation @ centre])))
    return made


def assert_rigid(cameras) -> None:
    for camera in cameras:
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(camera.rotation) == pytest.approx(1.0)


def test_a_turntable_is_an_even_closed_circle() -> None:
    cameras = orbit(36)
    path = turntable(cameras, TARGET, UP, 24)
    assert_rigid(path)
    away = centres_cm(path) - [3.0, -2.0, 35.0]
    real = centres_cm(cameras) - [3.0, -2.0, 35.0]
    np.testing.assert_allclose(np.hypot(away[:, 0], away[:, 1]), np.median(np.hypot(real[:, 0], real[:, 1])))
    np.testing.assert_allclose(away[:, 2], np.median(real[:, 2]))
    angles = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    # Also from the last view to the first: the film can be looped.
    np.testing.assert_allclose(np.diff(np.append(angles, angles[0] + 2 * np.pi)), 2 * np.pi / 24)
    assert angles[0] == pytest.approx(np.arctan2(real[0, 1], real[0, 0]))


def test_a_turntable_looks_at_its_target_upright() -> None:
    for camera in turntable(orbit(20), TARGET, UP, 7):
        pixels, depths = camera.project(np.stack([TARGET, TARGET + 0.1 * UP]))
        assert (depths > 0).all()
        np.testing.assert_allclose(pixels[0], [camera.cx, camera.cy], atol=1e-6)
        assert pixels[1, 0] == pytest.approx(camera.cx) and pixels[1, 1] < camera.cy


def test_a_walk_passes_where_the_cameras_stood() -> None:
    cameras = orbit(60)
    path = walk(cameras, 150)
    assert_rigid(path)
    real, made = centres_cm(cameras), centres_cm(path)
    nearest = np.linalg.norm(real[:, None] - made, axis=2)
    # A camera stands every 14 cm; smoothing cuts the ends short by about one of them.
    assert nearest[2:-2].min(axis=1).max() < 6.0
    assert nearest[[0, -1]].min(axis=1).max() < 25.0
    assert nearest[0].argmin() == 0 and nearest[-1].argmin() == 149
    for camera in path:
        closest = min(cameras, key=lambda other: np.linalg.norm(other.centre - camera.centre))
        turn = Rotation.from_matrix(camera.rotation @ closest.rotation.T).magnitude()
        assert np.degrees(turn) < 8.0


def test_a_walk_is_steady_though_the_hand_shook_and_paused() -> None:
    cameras = orbit(60)
    held = shaken(cameras[:20] + [cameras[20]] * 15 + cameras[20:], seed=3, cm=0.5, degrees=0.5)
    steps = np.linalg.norm(np.diff(centres_cm(walk(held, 200)), axis=0), axis=1)
    assert steps.std() < 0.2 * steps.mean()
    turns = [a.rotation @ b.rotation.T for a, b in zip(walk(held, 200), walk(cameras, 200), strict=True)]
    assert np.degrees(Rotation.from_matrix(turns).magnitude()).max() < 8.0


def test_a_walk_needs_two_cameras() -> None:
    assert len(walk(orbit(36)[:2], 5)) == 5
    with pytest.raises(ValueError, match="at least 2"):
        walk(orbit(36)[:1], 5)


@pytest.mark.parametrize("count", [1, 2, 1500])
def test_frames_are_named_in_order(count: int) -> None:
    for path in (turntable(orbit(5), TARGET, UP, count), walk(orbit(5), count)):
        names = [camera.name for camera in path]
        assert len(names) == len(set(names)) == count and names == sorted(names)
        assert names[0] in ("000", "0000")


@pytest.mark.parametrize("size", [(200, 300), (480, 270), (1920, 540)])
def test_another_shape_shows_the_same_from_top_to_bottom(size: tuple[int, int]) -> None:
    camera = replace(orbit(5)[0], cx=250.0, cy=130.0)
    other = reframe(camera, *size)
    assert (other.width, other.height) == size and other.fx == pytest.approx(other.fy)
    points = POSE.scene(np.array([[0, 0, 0], [3, 4, 60], [-10, 5, 30.0]]))
    scale = size[1] / camera.height
    expected = (camera.project(points)[0] - [camera.width / 2, 0]) * scale + [size[0] / 2, 0]
    np.testing.assert_allclose(other.project(points)[0], expected)
