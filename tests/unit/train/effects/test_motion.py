"""What motion does to images: a rolling shutter of known read-out time and blur of known length are found again."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from cotton3dg.core.scene import Camera
from cotton3dg.gaussians.views import View
from cotton3dg.train.effects.motion import Tracks, find_longest_tracks, measure_velocities
from cotton3dg.train.effects.motion_blur import LENGTHS_PX, MotionBlur, blur_length, estimate_motion_blur, smear
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


def slide(length_px: float, flow_px: float = 12.0, direction=(0.8, 0.6), noise: float = 2.0, n_views: int = 8):
    """Views of a plane of spots that slides by, blurred along its way, and their tracks."""
    rng = np.random.default_rng(3)
    way = np.array(direction)
    size, focal = (320, 240), 100.0
    tracks_of, views, cameras = [], [], []
    for number in range(n_views):
        fine = cv2.GaussianBlur(rng.normal(0, 1, (8 * 62, 8 * 82)), (0, 0), 1.2)
        picture = 120 + 40 * fine[:240, :320] / fine.std()
        if length_px:
            steps = np.linspace(-0.5, 0.5, 4 * int(np.ceil(length_px)) + 1) * length_px
            picture = np.mean(
                [cv2.warpAffine(picture, np.float64([[1, 0, s * way[0]], [0, 1, s * way[1]]]), size) for s in steps],
                axis=0,
            )
        picture = np.clip(picture + rng.normal(0, noise, picture.shape), 0, 255).astype(np.uint8)
        pose = np.column_stack([np.eye(3), [*(number * flow_px / focal * way), 0]])
        cameras.append(Camera(f"{number}.jpg", *size, focal, focal, 160.0, 120.0, pose))
        views.append(View(cameras[-1], np.repeat(picture[..., None], 3, axis=2)))
        tracks_of.append(np.column_stack([rng.uniform(40, 280, 150), rng.uniform(40, 200, 150)]))
    n = 150 * n_views
    xyz = np.column_stack([rng.uniform(-1, 1, (n, 2)), np.ones(n)])
    numbers = np.repeat(np.arange(n_views), 150)
    return views, Tracks(
        cameras, np.arange(n_views, dtype=float), numbers, np.arange(n), np.concatenate(tracks_of), xyz
    )


@pytest.mark.parametrize(
    ("length_px", "direction"), [(4.0, (0.8, 0.6)), (8.0, (1.0, 0.0)), (8.0, (0.0, -1.0)), (12.0, (0.6, -0.8))]
)
def test_the_length_of_motion_blur_is_found(length_px, direction):
    found = estimate_motion_blur(*slide(length_px, flow_px=16.0, direction=direction))
    assert found.median_px == pytest.approx(length_px, rel=0.2)
    assert found.flow_px == pytest.approx(16.0, rel=1e-6)
    assert found.error_px < 0.5
    assert found.strong_px >= found.median_px
    assert found.found


def test_sharp_images_give_no_evidence():
    found = estimate_motion_blur(*slide(0.0))
    assert found.median_px < 1
    assert not found.found


def test_blur_is_told_in_pixels_of_the_images_that_are_looked_at():
    views, tracks = slide(8.0)
    small = [view.limited(160) for view in views]
    assert estimate_motion_blur(small, tracks).median_px == pytest.approx(4.0, rel=0.3)
    assert estimate_motion_blur(small, tracks).flow_px == pytest.approx(6.0, rel=1e-6)


def test_what_stands_still_is_not_blurred():
    found = estimate_motion_blur(*slide(8.0, flow_px=0.1))
    assert np.isnan(found.lengths_px).all()
    assert not found.found
    assert not MotionBlur(np.full(5, 6.0), np.full(5, 4.0)).found


def test_a_smear_is_told_from_its_correlation():
    sharp = np.exp(-(np.arange(32) ** 2) / 3.0) - 0.1 * np.exp(-((np.arange(32) - 4) ** 2) / 8.0)
    smears = np.array([smear(sharp, length) for length in LENGTHS_PX])
    np.testing.assert_allclose(smears[0], sharp)
    assert blur_length(0.7 * smear(sharp, 6.5), smears) == 6.5
