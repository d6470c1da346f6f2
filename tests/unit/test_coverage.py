"""Pairs to match and the shape of the camera path."""

import numpy as np
import pytest

from cotton3dg.capture.coverage import GAP_BIN_DEG, coverage, out_of_view
from cotton3dg.capture.image_pairs import image_pairs
from cotton3dg.core.scene import Camera


def test_ordered_pairs_close_the_ring():
    pairs = image_pairs(100, 8, ordered=True)
    assert (0, 99) in pairs and (0, 1) in pairs and (1, 98) in pairs
    assert all(0 <= i < j < 100 for i, j in pairs)
    assert len(set(pairs)) == len(pairs) < 900


def test_every_image_has_neighbours_on_both_sides():
    degree = [sum(k in (i, j) for i, j in image_pairs(100, 8, ordered=True)) for k in range(100)]
    assert min(degree) == 16


def test_a_second_turn_is_tied_to_the_first():
    """Two turns in 100 frames: each half of the second turn has a pair that looks at the same side."""
    pairs = image_pairs(100, 8, ordered=True)
    tied = {j // 10 for i, j in pairs if abs(j - i - 50) <= 4}
    assert tied >= {5, 6, 7, 8, 9}


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_few_images_give_each_pair_once(n):
    pairs = image_pairs(n, 8, ordered=True)
    assert len(pairs) == len(set(pairs)) == n * (n - 1) // 2


def test_unordered_images_are_all_matched_while_few():
    assert len(image_pairs(60, 8, ordered=False)) == 60 * 59 // 2
    assert len(image_pairs(100, 8, ordered=False)) < 2000


def _circle(angles_deg, tilt=0.3, target=(4.0, -2.0, 7.0)):
    """Cameras on a circle of radius 2 about `target`, a little above it, looking at it."""
    angles = np.radians(angles_deg)
    flat = np.stack([2 * np.cos(angles), 2 * np.sin(angles), np.full(len(angles), 0.4)], axis=1)
    rotation = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    offsets = flat @ rotation.T
    return offsets + target, -offsets / np.linalg.norm(offsets, axis=1, keepdims=True), rotation[:, 2]


def test_full_circle():
    centres, forwards, axis = _circle(np.arange(0, 360, 5))
    found = coverage(centres, forwards)
    assert abs(found.axis @ axis) == pytest.approx(1)
    np.testing.assert_allclose(found.target, (4, -2, 7), atol=1e-4)
    assert found.radius_su == pytest.approx(np.hypot(2, 0.4), rel=1e-4)
    assert found.coverage_deg == pytest.approx(360)
    assert found.largest_gap_deg == pytest.approx(5, abs=0.01)


def test_half_circle_leaves_a_gap():
    centres, forwards, _ = _circle(np.arange(0, 181, 5))
    found = coverage(centres, forwards)
    assert found.largest_gap_deg == pytest.approx(180, abs=0.1)
    assert found.coverage_deg == pytest.approx(180 + GAP_BIN_DEG, abs=0.1)


def test_parallel_views_stay_finite():
    centres = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0.1, 0]])
    found = coverage(centres, np.tile([0.0, 0, 1], (4, 1)))
    assert np.isfinite([*found.target, *found.axis, found.radius_su, found.coverage_deg]).all()


def test_images_without_the_plant_are_named():
    angles = np.radians(np.arange(0, 360, 30))
    cameras = []
    for number, angle in enumerate(angles):
        centre = np.array([3 * np.cos(angle), 3 * np.sin(angle), 1.0])
        forward = -centre / np.linalg.norm(centre)
        right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
        rows = np.stack([right, np.cross(forward, right), forward])
        if number == 4:  # looks away
            rows = rows @ np.diag([-1.0, -1.0, 1.0])
        cameras.append(Camera(f"{number}.jpg", 64, 48, 60, 60, 32, 24, np.column_stack([rows, -rows @ centre])))
    assert out_of_view(np.zeros(3), cameras) == ["4.jpg"]
    assert out_of_view(np.array([0, 0, 50.0]), cameras) == [camera.name for camera in cameras]
