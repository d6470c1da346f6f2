# SPDX-License-Identifier: Apache-2.0
"""Images that structure from motion lost: which steps are tried, in which order, and what they bring back."""

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pycolmap
import pytest
from scenes.room_scene import pose, render, textures

from cotton3dg.core.runs import silent
from cotton3dg.io.images import write_image
from cotton3dg.schemas.sfm import RescueStep
from cotton3dg.sfm import registration_recovery
from cotton3dg.sfm.epipolar_consistency import contradicted_pct, sampson
from cotton3dg.sfm.features import Features, FeatureSettings, features_of_images
from cotton3dg.sfm.image_pairs import choose_pairs
from cotton3dg.sfm.mapper import map_images, write_database
from cotton3dg.sfm.marker_corners import match_marker_corners
from cotton3dg.sfm.matching import PairMatches, match_pairs
from cotton3dg.sfm.registration_recovery import (
    Attempt,
    Task,
    follow_into_lost,
    place_by_markers,
    place_globally,
    recover_registration,
)
from cotton3dg.sfm.tracking import follow

OVERLAP, SEED = 6, 0
FEATURES = FeatureSettings(1500, 1280, far_apart=False)


def told(placed: int) -> Attempt:
    """An attempt that placed so many of the images."""
    model = SimpleNamespace(num_reg_images=lambda: placed, reg_image_ids=list)
    return Attempt({}, {}, [model] if placed else [])


@pytest.mark.parametrize(
    ("first", "brought", "tried"),
    [
        (96, [], []),
        (85, [97], ["following"]),
        (85, [90, 99], ["following", "following"]),
        (50, [60, 99], ["following", "markers"]),
        (50, [60, 70, 99], ["following", "markers", "more features"]),
        (50, [60, 60, 40, 70, 96], ["following", "markers", "more features", "following", "all at once"]),
        (0, [0, 0, 30, 40, 96], ["following", "markers", "more features", "following", "all at once"]),
    ],
)
def test_each_step_is_tried_when_those_before_fell_short(monkeypatch, tmp_path, first, brought, tried) -> None:
    results = iter(brought)
    for name in ("follow_into_lost", "place_by_markers", "retry_with_more_features", "place_globally"):
        monkeypatch.setattr(registration_recovery, name, lambda *_: told(next(results)))
    task = Task(tmp_path, [str(i) for i in range(100)], tmp_path, FEATURES, OVERLAP, SEED)
    best, steps = recover_registration(task, told(first))
    assert [step.name for step in steps] == tried
    assert best.placed == max([first, *brought])
    known = first
    for step, placed in zip(steps, brought, strict=True):
        assert step == RescueStep(step.name, known, placed)
        known = max(known, placed)


def test_a_moved_image_is_followed_through_blur_and_back() -> None:
    rng = np.random.default_rng(0)
    first = cv2.resize(rng.integers(0, 255, (60, 80), np.uint8), (800, 600), interpolation=cv2.INTER_CUBIC)
    second = cv2.blur(np.roll(first, (9, 24), (0, 1)), (21, 1))
    places = rng.uniform([60, 60], [700, 540], (200, 2)).astype(np.float32)
    rows, found = follow(first, second, places)
    assert len(rows) > 100
    assert np.median(np.abs(found - places[rows] - (24, 9)), axis=0) == pytest.approx([0, 0], abs=0.5)
    rows, found = follow(first, np.full_like(first, 90), places)
    assert len(rows) == len(found) == 0
    assert len(follow(first, second, np.zeros((0, 2), np.float32))[0]) == 0


def walk(folder: Path, count: int, blurred: range, blur_px: int = 31) -> tuple[Task, Attempt, np.ndarray]:
    """A full turn in a room, some of whose images are blurred; what the mapper places, and the true centres."""
    faces, angles = textures(1), np.linspace(0, 2 * np.pi, count, endpoint=False)
    names = [f"{number:03d}.jpg" for number in range(count)]
    for number, name in enumerate(names):
        picture = render(faces, angles[number])
        write_image(folder / name, cv2.blur(picture, (blur_px, 1)) if number in blurred else picture)
    work = folder / "work"
    work.mkdir()
    task = Task(folder, names, work, FEATURES, OVERLAP, SEED)
    features = features_of_images(folder, names, range(count), FEATURES, silent)
    matches = match_pairs(features, choose_pairs(count, OVERLAP, True))
    write_database(work / "matches.db", folder, names, features, matches, None)
    models = map_images(work / "matches.db", folder, work, names, SEED, lambda: None)
    return task, Attempt(features, matches, models), np.array([pose(angle)[1] for angle in angles])


def farthest_off(model: pycolmap.Reconstruction, centres: np.ndarray) -> float:
    """Largest distance of a camera from its true place, relative to the orbit's radius."""
    images = [model.image(i) for i in model.reg_image_ids()]
    true = centres[[int(image.name[:3]) for image in images]]
    found = np.array([image.projection_center() for image in images])
    fitted = pycolmap.estimate_sim3d(found, true)
    off = np.linalg.norm((fitted.matrix() @ np.column_stack([found, np.ones(len(found))]).T).T - true, axis=1)
    return float(off.max() / np.linalg.norm(centres - centres.mean(axis=0), axis=1).mean())


@pytest.mark.slow
def test_blurred_images_of_a_walk_are_placed_by_following(tmp_path: Path) -> None:
    task, first, centres = walk(tmp_path, 30, range(8, 12))
    lost = first.lost(task.names)
    assert lost
    assert set(lost) <= {8, 9, 10, 11}
    before = first.placed
    found = follow_into_lost(task, first)
    assert found is not None
    assert found.placed > before
    assert first.placed == before, "the attempt before is kept as it was"
    assert farthest_off(found.models[0], centres) < 0.02
    assert contradicted_pct(found.models[0], task.names, found.features, found.matches) < 1.0
    at_once = place_globally(task, found)
    assert at_once is not None
    assert at_once.placed >= before
    assert farthest_off(at_once.models[0], centres) < 0.05


def test_where_nothing_is_lost_or_known_there_is_nothing_to_follow(tmp_path: Path) -> None:
    task = Task(tmp_path, ["a", "b"], tmp_path, FEATURES, OVERLAP, SEED)
    assert follow_into_lost(task, told(0)) is None
    assert place_globally(task, told(0)) is None


def marked_faces() -> np.ndarray:
    """Of a bare room with markers on its floor, and on all sides of the box in it."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_1000)
    faces = np.full((12, 512, 512, 3), 225, np.uint8)
    for face, across in ((4, 7), *((face, 3) for face in range(6, 12))):
        step = 500 // across
        for k in range(across**2):
            top, left, side = 8 + step * (k // across), 8 + step * (k % across), int(0.8 * step)
            marker = cv2.aruco.generateImageMarker(dictionary, 50 * (face - 4) + k, side)
            faces[face, top : top + side, left : left + side] = marker[..., None]
    mirrored = [4, 7, 8]  # as this room's faces are laid out
    faces[mirrored] = faces[mirrored, ::-1]
    return faces


def test_markers_alone_place_the_images_of_a_bare_room(tmp_path: Path) -> None:
    faces, angles = marked_faces(), np.linspace(0, 2 * np.pi, 24, endpoint=False)
    names = [f"{number:03d}.jpg" for number in range(24)]
    for name, angle in zip(names, angles, strict=True):
        write_image(tmp_path / name, render(faces, angle))
    task = Task(tmp_path, names, tmp_path, FEATURES, OVERLAP, SEED)
    nothing = Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8))
    found = place_by_markers(task, Attempt(dict.fromkeys(range(24), nothing), {}, []))
    assert found is not None
    assert found.placed >= 20
    assert farthest_off(found.models[0], np.array([pose(angle)[1] for angle in angles])) < 0.05


def test_corners_join_the_matches_there_are_and_wrong_ones_do_not(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform(20, 380, (40, 2)).astype(np.float32)
    aside = np.column_stack([rng.uniform(5, 40, 40), np.zeros(40)]).astype(np.float32)  # places at many depths
    move = np.float32([14, 0])
    descriptors = np.zeros((40, 128), np.uint8)
    features = {0: Features(places, descriptors), 1: Features(places + aside, descriptors)}
    same = np.column_stack([np.arange(40), np.arange(40)]).astype(np.uint32)
    square = np.float32([[100, 100], [140, 102], [139, 141], [99, 140]])
    # Both show marker 7; 8 has gone elsewhere; 9 is seen once.
    squares = {0: {7: square, 8: square + 50, 9: square + 90}, 1: {8: square + np.float32([64, 140]), 7: square + move}}
    joined, matches = match_marker_corners(features, {(0, 1): PairMatches(np.eye(3), same)}, squares)
    assert len(joined[0].places_px) == 52
    assert len(joined[1].places_px) == 48
    rows = {tuple(row) for row in matches[0, 1].rows.tolist()}
    assert {(40 + k, 44 + k) for k in range(4)} <= rows
    assert not rows & {(44 + k, 40 + k) for k in range(4)}
    np.testing.assert_array_equal(joined[0].places_px[40:44], square)


def test_without_markers_there_is_nothing_to_tie(tmp_path: Path) -> None:
    task, first, _ = walk(tmp_path, 12, range(0))
    assert place_by_markers(task, first) is None


def test_a_wrong_pose_contradicts_the_matches(tmp_path: Path) -> None:
    task, right, _ = walk(tmp_path, 24, range(0))
    model = right.models[0]
    assert contradicted_pct(model, task.names, right.features, right.matches) == 0.0
    image = model.image(model.reg_image_ids()[5])
    turned = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([0.2, 0.0, 0.0])), np.zeros(3))
    model.frame(image.frame_id).rig_from_world = turned * image.cam_from_world()
    share = contradicted_pct(model, task.names, right.features, right.matches)
    number = task.names.index(image.name)
    of_image = np.mean([number in pair for pair in right.matches])
    assert share == pytest.approx(100 * of_image, rel=0.3)
    assert contradicted_pct(model, task.names, right.features, {}) is None


def test_accidental_matches_in_few_places_hardly_count(tmp_path: Path) -> None:
    """As many pairs with 16 accidental matches as there are true ones are no half of what images have in common."""
    task, right, _ = walk(tmp_path, 24, range(0))
    rng = np.random.default_rng(0)
    strangers = [(i, j) for i in range(24) for j in range(i + 1, 24) if (i, j) not in right.matches]
    accidental = {
        pair: PairMatches(np.eye(3), rng.integers(0, 100, (16, 2)).astype(np.uint32))
        for pair in strangers[: len(right.matches)]
    }
    true = sum(min(len(found.rows), 100) for found in right.matches.values())
    share = contradicted_pct(right.models[0], task.names, right.features, right.matches | accidental)
    assert share == pytest.approx(100 * 16 * len(accidental) / (16 * len(accidental) + true), rel=0.1)
    assert share < 20


def test_sampson_is_the_distance_from_the_epipolar_line() -> None:
    """A step to the right: epipolar lines are level, and half of a vertical offset goes to each of the two images."""
    aside = pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([-1.0, 0.0, 0.0]))
    first = np.array([[0.1, 0.2], [0.0, -0.1]])
    error = sampson(aside, first, first + np.array([[-0.3, 0.0], [-0.1, 0.004]]))
    assert error == pytest.approx([0.0, 0.004 / np.sqrt(2)])
