# SPDX-License-Identifier: Apache-2.0
"""A plant that the frame cuts is told, one that now and then touches it is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cotton3dg.core.scene import Camera
from cotton3dg.traits.error_model import Conditions
from cotton3dg.traits.stage import _conditions
from cotton3dg.traits.truncation import check_truncation, find_cut
from cotton3dg.workspace import Workspace


def look(azimuth_deg: float, aim: float) -> Camera:
    """640 x 360 px, from 1.4 m, at a height of the axis."""
    a = np.radians(azimuth_deg)
    centre, target = np.array([1.4 * np.cos(a), 1.4 * np.sin(a), 0.4]), np.array([0, 0, aim])
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0, 0, 1.0]) / np.linalg.norm(np.cross(forward, [0, 0, 1.0]))
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.column_stack([rotation, -rotation @ centre])
    return Camera(f"{azimuth_deg:.0f}.jpg", 640, 360, 525.0, 525.0, 320.0, 180.0, pose)


@pytest.fixture
def stem() -> np.ndarray:
    return np.column_stack([np.zeros((1000, 2)), np.linspace(0, 0.7, 1000)])


def test_a_plant_in_the_middle_is_whole(stem: np.ndarray) -> None:
    cameras = [look(azimuth, 0.35) for azimuth in range(0, 360, 30)]
    assert find_cut(stem, cameras) == []
    assert check_truncation(stem, cameras) == ("", False)
    assert find_cut(stem[:0], cameras) == []


def test_images_that_cut_it_are_told_when_they_are_many(stem: np.ndarray) -> None:
    cameras = [look(azimuth, 0.0 if azimuth < 120 else 0.35) for azimuth in range(0, 360, 30)]
    assert find_cut(stem, cameras) == ["0.jpg", "30.jpg", "60.jpg", "90.jpg"]
    warning, lost = check_truncation(stem, cameras)
    assert "in 4 of 12 images, e.g. 0.jpg, so height and canopy may be too small" in warning
    assert not lost
    assert check_truncation(stem, cameras[1:4] + cameras[4:] * 2) == ("", False)


def test_a_model_that_ends_at_the_edge_of_all_images_is_cut(stem: np.ndarray) -> None:
    cameras = [look(azimuth, 0.0) for azimuth in range(0, 360, 30)]
    seen = np.all([camera.project(stem)[0][:, 1] > 0 for camera in cameras], axis=0)
    assert 0.3 < seen.mean() < 0.9
    assert len(find_cut(stem[seen], cameras)) == 12
    warning, lost = check_truncation(stem[seen], cameras)
    assert "cannot be measured" in warning
    assert lost


def test_a_foot_below_the_frame_leaves_the_size_known(stem: np.ndarray) -> None:
    cameras = [look(azimuth, 0.75) for azimuth in range(0, 360, 30)]
    assert len(find_cut(stem, cameras)) == 12
    assert not check_truncation(stem, cameras)[1]


def test_the_walk_tells_the_errors_what_it_left_out(tmp_path: Path) -> None:
    half = [look(azimuth, 0.35) for azimuth in range(0, 201, 10)]
    assert _conditions(Workspace(tmp_path), half, 0.0).gap_deg == pytest.approx(160, abs=2)
    assert _conditions(Workspace(tmp_path), [], 0.4) == Conditions(joining=0.4)
