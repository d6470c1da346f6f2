# SPDX-License-Identifier: Apache-2.0
"""Blur of known length is found again."""

import cv2
import numpy as np
import pytest

from cotton3dg.core.scene import Camera
from cotton3dg.gaussians.views import View
from cotton3dg.train.effects.motion import Tracks
from cotton3dg.train.effects.motion_blur import LENGTHS_PX, MotionBlur, blur_length, estimate_motion_blur, smear


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
