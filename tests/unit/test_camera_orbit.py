"""Orbits and the choice of views on them."""

import numpy as np
import pytest
from scenes.lint_scene import orbit_cameras

from cotton3dg.geometry.camera_orbit import azimuths, evenly_spaced, fit_orbit


def test_orbit_of_a_full_turn() -> None:
    orbit = fit_orbit(orbit_cameras(24))
    np.testing.assert_allclose(orbit.axis, [0, 0, 1], atol=0.02)
    np.testing.assert_allclose(orbit.centre, [0, 0, 0.36], atol=0.01)
    assert orbit.radius == pytest.approx(1.3, rel=0.01)


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


def test_one_camera_is_no_orbit() -> None:
    with pytest.raises(ValueError, match="at least 2"):
        fit_orbit(orbit_cameras(1))


def test_azimuths_go_once_around() -> None:
    cameras = orbit_cameras(12)
    angles = azimuths(cameras, fit_orbit(cameras))
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
