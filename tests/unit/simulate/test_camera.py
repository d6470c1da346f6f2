# SPDX-License-Identifier: Apache-2.0
"""The walk around a simulated plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes.simulated_plant import SMALL, TINY, small_plant

from cotton3dg.options import SimulateOptions
from cotton3dg.simulate.camera import orbit
from cotton3dg.simulate.plant import grow_plant


def test_the_turn_closes_and_keeps_the_whole_plant_in_view():
    plant = small_plant()
    path = orbit(SMALL, plant.vertices)
    cameras = path.cameras()
    assert len(cameras) == SMALL.frames
    centres = np.array([camera.centre for camera in cameras]) - path.centre
    angles = np.unwrap(np.arctan2(centres[:, 1], centres[:, 0]))
    assert 360 < abs(np.rad2deg(angles[-1] - angles[0])) < 385
    assert 1.0 < np.linalg.norm(centres[:, :2], axis=1).min() < 1.8
    assert np.ptp(centres[:, 2]) > 0.03
    for camera in cameras:
        pixels, depths = camera.project(plant.vertices)
        assert (depths > 0.5).all()
        assert ((pixels > 0) & (pixels < (camera.width, camera.height))).all()
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(camera.rotation) == pytest.approx(1)


def test_local_shots_go_round_close_by_at_three_heights():
    """A stick of 0.9 m: the thirds' middles are 0.3 m apart, and the camera is half a metre away."""
    stick = np.column_stack([np.zeros((200, 2)), np.linspace(0, 0.9, 200)])
    near = orbit(SimulateOptions(shot="local", frames=301), stick)
    far = orbit(SimulateOptions(frames=301), stick)
    places = np.array([camera.centre for camera in near.cameras()])
    away = np.linalg.norm(places[:, :2], axis=1)
    assert np.median(away) == pytest.approx(0.55, abs=0.05) and np.linalg.norm(far.at(0).centre[:2]) > 1.0
    levels = [np.median(places[part, 2]) for part in (slice(5, 85), slice(105, 185), slice(205, 295))]
    assert np.diff(levels) == pytest.approx([0.3, 0.3], abs=0.12)  # a hand sways by up to 6 cm
    angles = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    assert abs(angles[-1] - angles[0]) == pytest.approx(3 * abs(near.turn), abs=0.1)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() < 3 * np.median(steps)  # no jump between two heights


def test_another_walk_is_around_the_same_plant():
    plant = small_plant()
    paths = [orbit(replace(SMALL, walk=walk), plant.vertices) for walk in (0, 1, 2)]
    assert len({path.start for path in paths}) == 3
    np.testing.assert_array_equal(grow_plant(replace(SMALL, walk=1)).wood.vertices, plant.wood.vertices)


def test_the_camera_goes_farther_away():
    vertices = small_plant().vertices
    near, far = (orbit(replace(SMALL, farther=farther), vertices) for farther in (0.0, 0.25))
    assert far.radius == pytest.approx(1.25 * near.radius)
    assert far.height == near.height


def path_of(**options):
    return orbit(replace(TINY, **options), small_plant().vertices)


def test_part_of_a_turn() -> None:
    assert abs(path_of().turn) > np.radians(360)
    half = path_of(turn_deg=180.0)
    assert abs(half.turn) == pytest.approx(np.pi)
    assert np.sign(half.turn) == np.sign(path_of().turn)


def test_an_uneven_pace_goes_the_same_way() -> None:
    even, uneven = path_of(), path_of(uneven=0.9)
    for frame in (0, 23):
        a, b = (path.at(frame).centre[:2] / np.linalg.norm(path.at(frame).centre[:2]) for path in (even, uneven))
        np.testing.assert_allclose(a, b, atol=0.01)
    steps = np.linalg.norm(np.diff([camera.centre for camera in uneven.cameras()], axis=0), axis=1)
    assert steps.max() > 5 * steps.min()


@pytest.mark.parametrize("cut", [0.2, 0.5])
def test_the_frame_cuts_the_plant_at_the_top(cut: float) -> None:
    plant = small_plant()
    low, high = plant.vertices[:, 2].min(), plant.vertices[:, 2].max()
    middle = plant.vertices.mean(axis=0) * (1, 1, 0)
    for camera in path_of(cut=cut).cameras()[::6]:
        places = middle + np.array([[0, 0, high - (cut + d) * (high - low)] for d in (-0.12, 0.12)])
        above, below = camera.project(places)[0][:, 1]
        assert above < 0 < below
