"""Choosing frames while a film streams by: the camera's way, the frames that are held, colours as ffmpeg has them."""

from __future__ import annotations

import subprocess

import cv2
import numpy as np
import pytest

from cotton3dg.frames.camera_travel import WayMeter
from cotton3dg.frames.keyframe_buffer import HeldFrames, select_keyframes
from cotton3dg.frames.take_video import _looked_at_every
from cotton3dg.io import video

WIDTH, HEIGHT = 320, 180


def panorama(width: int = 4000) -> np.ndarray:
    """(HEIGHT, width) grey blobs of all sizes."""
    rng = np.random.default_rng(0)
    layers = [cv2.resize(rng.random((HEIGHT // s, width // s), np.float32), (width, HEIGHT)) for s in (4, 16, 45)]
    return (np.mean(layers, axis=0) * 255).astype(np.uint8)


def ways_of(offsets: np.ndarray) -> np.ndarray:
    """What the meter says of a camera that pans by whole pixels."""
    wide, meter = panorama(), WayMeter()
    return np.array([meter.add(np.ascontiguousarray(wide[:, x : x + WIDTH])) for x in offsets])


def test_the_way_is_that_of_the_picture() -> None:
    ways = ways_of(np.arange(0, 1600, 5))
    np.testing.assert_allclose(ways, np.arange(0, 1600, 5) / WIDTH, atol=0.03 * 1600 / WIDTH)


def test_a_hand_that_trembles_does_not_get_anywhere() -> None:
    trembling = 40 + np.random.default_rng(1).integers(-3, 4, 300)
    assert ways_of(trembling)[-1] < 8 / WIDTH


def test_a_covered_lens_goes_on_as_before() -> None:
    wide, meter = panorama(), WayMeter()
    for k in range(40):
        frame = np.ascontiguousarray(wide[:, 6 * k : 6 * k + WIDTH])
        meter.add(np.zeros_like(frame) if 18 <= k < 22 else frame)
    assert meter.way == pytest.approx(39 * 6 / WIDTH, rel=0.25)


def test_lingering_does_not_double_views_and_hurrying_does_not_tear_the_orbit(tmp_path) -> None:
    """600 frames at one place, a slow part, a fast part: the frames chosen are at even steps of the way."""
    ways = np.concatenate([np.full(600, 0.1), np.linspace(0.1, 2, 300), np.linspace(2, 5, 60)])
    scores = np.random.default_rng(0).uniform(0.7, 1, len(ways))
    held = HeldFrames(80, 4, np.uint8, tmp_path)
    for number, (way, score) in enumerate(zip(ways, scores, strict=True)):
        held.offer(number, float(way), float(score), np.full(4, number % 251, np.uint8))
    rows = np.array(held.frames)
    assert 50 <= len(rows) <= 80
    assert all((held.numbers_of(number) == number % 251).all() for number in rows)
    chosen = rows[select_keyframes(ways[rows], scores[rows], 40)]
    steps = np.diff(ways[chosen])
    assert len(chosen) == 40
    assert (ways[chosen] == 0.1).sum() <= 2
    assert steps.max() < 2.2 * np.median(steps)


def test_every_frame_is_held_while_there_is_room(tmp_path) -> None:
    held = HeldFrames(50, 1, np.uint8, tmp_path)
    for number in range(50):
        held.offer(number, 0.0, 1.0, np.zeros(1, np.uint8))
    assert held.frames == list(range(50))


def test_the_best_frame_of_an_interval_is_held(tmp_path) -> None:
    held = HeldFrames(10, 1, np.uint8, tmp_path)
    for number in range(200):
        held.offer(number, number / 10, float(number % 4 == 2), np.zeros(1, np.uint8))
    assert len(held.frames) >= 5
    assert all(number % 4 == 2 for number in held.frames)


def test_thinning_prefers_the_sharp() -> None:
    scores = np.where(np.arange(100) % 4 == 2, 1.0, 0.1)
    kept = np.array(select_keyframes(np.arange(100.0), scores, 25))
    assert len(kept) == 25
    assert (kept % 4 == 2).sum() >= 23
    assert select_keyframes(np.arange(5.0), np.ones(5), 9) == [0, 1, 2, 3, 4]
    assert select_keyframes(np.arange(5.0), np.ones(5), 3) == [0, 2, 4]


@pytest.mark.parametrize(
    ("pixel_format", "tags"),
    [("yuv420p", ""), ("yuv420p", "bt709"), ("yuvj420p", "bt709"), ("yuv444p", "smpte170m"), ("yuv420p10le", "")],
)
def test_colours_are_those_of_the_film(tmp_path, pixel_format: str, tags: str) -> None:
    path = tmp_path / "film.mkv"
    rng = np.random.default_rng(3)
    picture = cv2.resize(rng.integers(0, 256, (6, 10, 3), np.uint8), (160, 90), interpolation=cv2.INTER_CUBIC)
    command = [video.ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "160x90", "-r", "5"]
    matrix = {"bt709": ":out_color_matrix=bt709"}.get(tags, "")
    command += ["-i", "pipe:0", "-vf", f"scale=iw:ih{matrix}", "-pix_fmt", pixel_format, "-c:v", "ffv1"]
    command += ["-colorspace", tags, "-color_primaries", tags, "-color_trc", tags] if tags else []
    subprocess.run([*command, str(path)], input=picture.tobytes() * 3, check=True)
    facts = video.probe(path)
    scan = video.scan(path, facts, 1000, lambda frame: frame.rgb())
    (by_ffmpeg,) = video.read_frames(path, facts, [1], 1000)
    error, of_ffmpeg = (np.abs(rgb.astype(int) - picture).mean() for rgb in (scan.measures[1], by_ffmpeg))
    assert error < max(1.0, of_ffmpeg)
    assert np.abs(scan.measures[1].mean(axis=(0, 1)) - by_ffmpeg.mean(axis=(0, 1))).max() < 1.0


def test_every_second_frame_of_a_fast_film_is_looked_at(tmp_path) -> None:
    path = tmp_path / "fast.mkv"
    frames = b"".join(np.full((36, 64, 3), 4 * k, np.uint8).tobytes() for k in range(41))
    command = [video.ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "64x36", "-r", "60"]
    subprocess.run([*command, "-i", "pipe:0", "-c:v", "ffv1", str(path)], input=frames, check=True)
    scan = video.scan(path, video.probe(path), 64, lambda frame: round(float(frame.grey(64).mean())), every=2)
    np.testing.assert_allclose(scan.measures, np.arange(0, 164, 8), atol=2)
    assert len(scan.timestamps_s) == 41 == scan.intact.sum()


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuvj420p"])
def test_a_grey_picture_outlives_its_frame(tmp_path, pixel_format: str) -> None:
    """Of full-range film it once was the buffer that the next frame is read into, so that nothing seemed to move."""
    path = tmp_path / "film.mkv"
    frames = b"".join(np.full((36, 64, 3), 40 * k, np.uint8).tobytes() for k in range(6))
    command = [video.ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "64x36", "-r", "25"]
    command += ["-i", "pipe:0", "-vf", "scale=iw:ih", "-pix_fmt", pixel_format, "-c:v", "ffv1", str(path)]
    subprocess.run(command, input=frames, check=True)
    scan = video.scan(path, video.probe(path), 64, lambda frame: frame.grey(64))
    np.testing.assert_allclose([grey.mean() for grey in scan.measures], np.arange(0, 240, 40), atol=2)


def test_long_and_fast_films_are_looked_at_more_sparsely() -> None:
    assert _looked_at_every(30.0, 799, 100) == 1
    assert _looked_at_every(30.0, 900, 100) == 2
    assert _looked_at_every(60.0, 1600, 100) == 4
    assert _looked_at_every(60.0, 2400, 100) == 5  # 12 a second
    assert _looked_at_every(30.0, 10**6, 100) == 2  # a header may claim anything
    assert _looked_at_every(float("nan"), 0, 100) == 1
