# SPDX-License-Identifier: Apache-2.0
"""Orbits and the choice of views on them."""

import numpy as np
import pytest
from scenes.lint_scene import orbit_cameras

from cotton3dg.core.scene import Camera
from cotton3dg.geometry.camera_orbit import GAP_BIN_DEG, azimuths, evenly_spaced, find_out_of_view, find_up, fit_orbit


def test_orbit_of_a_full_turn() -> None:
    orbit = fit_orbit(orbit_cameras(24))
    np.testing.assert_allclose(orbit.axis, [0, 0, 1], atol=0.02)
    np.testing.assert_allclose(orbit.centre, [0, 0, 0.36], atol=0.01)
    assert orbit.radius == pytest.approx(1.3, rel=0.01)


@pytest.mark.parametrize(("turn", "within_deg"), [(2 * np.pi, 0.1), (np.pi, 1.0), (0.5, 25.0)])
def test_level_cameras_know_up_without_a_whole_turn(turn: float, within_deg: float) -> None:
    cameras = orbit_cameras(24, turn=turn)
    mean = -np.mean([camera.rotation[1] for camera in cameras], axis=0)
    off_deg = [np.degrees(np.arccos(up[2] / np.linalg.norm(up))) for up in (find_up(cameras), mean)]
    assert off_deg[0] < within_deg
    assert off_deg[0] <= off_deg[1] + 1e-6


def test_one_camera_knows_up_as_well_as_it_is_held() -> None:
    (camera,) = orbit_cameras(1)
    np.testing.assert_allclose(find_up([camera]), -camera.rotation[1], atol=1e-9)


def test_a_short_arc_takes_the_axis_from_the_cameras() -> None:
    orbit = fit_orbit(orbit_cameras(8, turn=0.5))
    assert orbit.axis[2] > 0.95
    np.testing.assert_allclose(orbit.centre, [0, 0, 0.36], atol=0.02)


def test_one_camera_that_looks_elsewhere_hardly_moves_the_centre() -> None:
    from dataclasses import replace

    cameras = orbit_cameras(24)
    turned = np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]]) @ cameras[5].cam_from_scene
    cameras[5] = replace(cameras[5], cam_from_scene=turned)
    assert np.linalg.norm(fit_orbit(cameras).centre - [0, 0, 0.36]) < 0.02


def test_one_camera_has_an_orbit_of_no_size() -> None:
    (camera,) = cameras = orbit_cameras(1)
    orbit = fit_orbit(cameras)
    assert orbit.centre == pytest.approx(camera.centre, abs=1e-6)
    assert (orbit.radius, orbit.distance, orbit.largest_gap_deg) == pytest.approx((0, 0, 360), abs=1e-6)
    with pytest.raises(ValueError, match="got none"):
        fit_orbit([])


def camera_at(centre: np.ndarray, forward: np.ndarray, up: np.ndarray, name: str = "a.jpg") -> Camera:
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Camera(name, 64, 48, 60, 60, 32, 24, np.column_stack([rotation, -rotation @ centre]))


def circle(angles_deg: np.ndarray, tilt: float = 0.3) -> tuple[list[Camera], np.ndarray]:
    """Cameras on a circle of radius 2 about (4, -2, 7), a little above it, looking at it; and their axis."""
    rotation = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    offsets = [rotation @ [2 * np.cos(a), 2 * np.sin(a), 0.4] for a in np.radians(angles_deg)]
    up = rotation[:, 2]
    return [camera_at((4, -2, 7) + o, -o / np.linalg.norm(o), up) for o in offsets], up


def test_a_full_circle_leaves_no_gap() -> None:
    cameras, axis = circle(np.arange(0, 360, 5))
    orbit = fit_orbit(cameras)
    np.testing.assert_allclose(orbit.axis, axis, atol=1e-9)
    np.testing.assert_allclose(orbit.centre, (4, -2, 7), atol=1e-5)
    assert orbit.radius == pytest.approx(2, rel=1e-5)
    assert orbit.distance == pytest.approx(np.hypot(2, 0.4), rel=1e-5)
    assert orbit.coverage_deg == pytest.approx(360)
    assert orbit.largest_gap_deg == pytest.approx(5, abs=0.01)


def test_a_half_circle_leaves_a_gap() -> None:
    orbit = fit_orbit(circle(np.arange(0, 181, 5))[0])
    assert orbit.largest_gap_deg == pytest.approx(180, abs=0.1)
    assert orbit.coverage_deg == pytest.approx(180 + GAP_BIN_DEG, abs=0.1)


def test_parallel_views_stay_finite() -> None:
    centres = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0.1, 0]])
    orbit = fit_orbit([camera_at(centre, np.array([0.0, 0, 1]), np.array([0.0, -1, 0])) for centre in centres])
    assert np.isfinite([*orbit.centre, *orbit.axis, orbit.radius, orbit.distance, orbit.coverage_deg]).all()


def test_images_without_the_plant_are_named() -> None:
    angles = np.radians(np.arange(0, 360, 30))
    up, cameras = np.array([0.0, 0, 1]), []
    for number, angle in enumerate(angles):
        centre = np.array([3 * np.cos(angle), 3 * np.sin(angle), 1.0])
        forward = (1 if number == 4 else -1) * centre / np.linalg.norm(centre)  # one looks away
        cameras.append(camera_at(centre, forward, up, f"{number}.jpg"))
    assert find_out_of_view(np.zeros(3), cameras) == ["4.jpg"]
    assert find_out_of_view(np.array([0, 0, 50.0]), cameras) == [camera.name for camera in cameras]


def test_azimuths_go_once_around() -> None:
    cameras = orbit_cameras(12)
    angles = azimuths(cameras, fit_orbit(cameras))
    assert angles[0] == 0
    np.testing.assert_allclose(np.sort(angles), np.arange(12) * np.pi / 6, atol=0.05)


@pytest.mark.parametrize("count", [1, 2, 4, 9, 36])
def test_chosen_views_leave_no_large_gap(count: int) -> None:
    # A hand that lingers: half of the images are taken on a tenth of the circle.
    angles = np.concatenate([np.linspace(0, 0.6, 100), np.linspace(0.6, 2 * np.pi, 100)])
    chosen = evenly_spaced(angles, count)
    assert len(chosen) == len(set(chosen.tolist())) == count
    assert (np.diff(chosen) > 0).all()
    sorted_angles = np.sort(angles[chosen])
    gaps = np.diff(np.append(sorted_angles, sorted_angles[0] + 2 * np.pi))
    assert gaps.max() <= 2 * 2 * np.pi / count + 0.1


def test_fewer_images_than_asked_for_are_all_taken() -> None:
    np.testing.assert_array_equal(evenly_spaced(np.array([0.0, 1.0, 2.0]), 5), [0, 1, 2])


def test_equal_angles_are_chosen_once_each() -> None:
    assert len(set(evenly_spaced(np.zeros(10), 4).tolist())) == 4
