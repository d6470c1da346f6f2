# SPDX-License-Identifier: Apache-2.0
"""What motion does to images: a rolling shutter of known read-out time is found again."""

from dataclasses import replace

import numpy as np
import pytest

from cotton3dg.core.scene import Camera
from cotton3dg.train.effects.motion import Tracks, find_longest_tracks, measure_velocities
from cotton3dg.train.effects.rolling_shutter import RollingShutter, estimate_rolling_shutter

N_VIEWS, N_POINTS = 30, 400


def walking(time: float, size: tuple[int, int]) -> Camera:
    """The camera at a time (frames) of a turn in 150 frames around the origin, not quite steady."""
    angle = 2 * np.pi * time / 150
    centre = 3 * np.array([np.cos(angle), np.sin(angle), 0.3 + 0.05 * np.sin(0.12 * time)])
    forward = np.array([0.05 * np.sin(0.15 * time), 0.0, 0.03 * np.cos(0.1 * time)]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.column_stack([rotation, -rotation @ centre])
    return Camera(f"{time:06.2f}.jpg", *size, 500.0, 500.0, size[0] / 2, size[1] / 2, pose)


def walk(read_out: float, size: tuple[int, int] = (640, 360), noise_px: float = 0.3) -> Tracks:
    """Every third frame; each point is seen where it is when its row (column, if upright) is read out."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform(-1.5, 1.5, (N_POINTS, 3))
    axis = 1 if size[0] >= size[1] else 0
    times = 3.0 * np.arange(N_VIEWS)
    cameras = [walking(time, size) for time in times]
    views, points, places = [], [], []
    for number, time in enumerate(times):
        moments = np.linspace(-0.5, 0.5, 5)
        seen_at = np.array([walking(time + read_out * moment, size).project(xyz)[0] for moment in moments])
        seen = seen_at[2]
        for _ in range(4):
            late = (seen[:, axis] / size[axis]).clip(0, 1) * (len(moments) - 1)
            before = late.astype(int).clip(max=len(moments) - 2)
            rest, all_points = (late - before)[:, None], np.arange(N_POINTS)
            seen = (1 - rest) * seen_at[before, all_points] + rest * seen_at[before + 1, all_points]
        inside = np.flatnonzero(((seen > 0) & (seen < size)).all(axis=1))
        views.append(np.full(len(inside), number))
        points.append(inside)
        places.append(seen[inside] + rng.normal(0, noise_px, (len(inside), 2)))
    return Tracks(cameras, times, *map(np.concatenate, (views, points, places)), xyz)


@pytest.mark.parametrize(("read_out", "size"), [(0.5, (640, 360)), (-0.4, (640, 360)), (0.5, (360, 640))])
def test_the_read_out_time_is_found(read_out, size):
    found = estimate_rolling_shutter(walk(read_out, size))
    assert found.read_out_frames == pytest.approx(read_out, abs=max(3 * found.error_frames, 0.02))
    assert found.error_frames < 0.05
    assert found.found


def test_a_global_shutter_gives_no_evidence():
    found = estimate_rolling_shutter(walk(0.0))
    assert abs(found.read_out_frames) < 4 * found.error_frames
    assert found.shift_px < 0.2
    assert not found.found


def test_the_read_out_time_survives_what_an_adjustment_does():
    tracks, rng = walk(0.5), np.random.default_rng(1)
    moved = replace(
        tracks,
        xyz=tracks.xyz + rng.normal(0, 0.001, tracks.xyz.shape),
        cameras=[
            replace(
                camera, cam_from_scene=camera.cam_from_scene + np.pad(rng.normal(0, 0.001, (3, 1)), ((0, 0), (3, 0)))
            )
            for camera in tracks.cameras
        ],
    )
    assert estimate_rolling_shutter(moved).read_out_frames == pytest.approx(
        estimate_rolling_shutter(tracks).read_out_frames, abs=0.02
    )


def test_cameras_and_points_take_up_most_of_it():
    found = estimate_rolling_shutter(walk(0.5))
    assert 0 < found.left_px < 0.5 * found.shift_px


def test_too_few_places_tell_nothing():
    tracks = walk(0.5)
    few = estimate_rolling_shutter(tracks[np.arange(100)])
    assert not few.found
    assert few.error_frames == np.inf
    assert RollingShutter(0.4, 0.01, 0.3, 0.0).found is False


def test_the_speed_of_points_is_that_of_the_walk():
    tracks = walk(0.0, noise_px=0)
    at = tracks.views == 10
    before, after = (walking(30.0 + dt, (640, 360)).project(tracks.xyz[tracks.points[at]])[0] for dt in (-0.5, 0.5))
    error = np.linalg.norm(measure_velocities(tracks)[at] - (after - before), axis=1)
    assert np.median(error) < 0.2 * np.median(np.linalg.norm(after - before, axis=1))
    gap = replace(tracks, times=np.where(np.arange(N_VIEWS) < 15, tracks.times, tracks.times + 100))
    unknown = np.isnan(measure_velocities(gap)).any(axis=1)
    assert set(gap.views[unknown]) == {14, 15}


def test_the_longest_tracks_are_taken():
    cameras = [walking(time, (640, 360)) for time in range(4)]
    seen = {
        camera.name: (np.full((len(ids), 2), 10.0 * i), np.array(ids, np.int64))
        for i, (camera, ids) in enumerate(zip(cameras, ([5, 9, 70], [5, 9], [5, 9, 12], [5, 12]), strict=True))
    }
    positions = np.array([5, 9, 12]), np.array([[1.0, 0, 0], [2, 0, 0], [3, 0, 0]])
    times = np.arange(4.0)
    tracks = find_longest_tracks(cameras, times, seen, positions, most=10)
    assert tracks.xyz[:, 0].tolist() == [1, 2]
    assert sorted(zip(tracks.views, tracks.points, strict=True)) == sorted(
        [(0, 0), (1, 0), (2, 0), (3, 0), (0, 1), (1, 1), (2, 1)]
    )
    assert find_longest_tracks(cameras, times, seen, positions, most=1).xyz[:, 0].tolist() == [1]
