# SPDX-License-Identifier: Apache-2.0
"""What the judgements of a capture answer to pictures whose state is known."""

import cv2
import numpy as np
import pytest

from cotton3dg.frames import frame_quality


@pytest.fixture
def textured():
    """(240, 320) random blobs of several sizes, like a room."""
    rng = np.random.default_rng(0)
    layers = [cv2.resize(rng.random((240 // s, 320 // s)).astype(np.float32), (320, 240)) for s in (2, 8, 40)]
    return (255 * np.mean(layers, axis=0)).astype(np.uint8)


def test_blurring_lowers_sharpness_and_raises_blur(textured):
    blurred = [textured] + [cv2.GaussianBlur(textured, (0, 0), sigma) for sigma in (1, 3, 8)]
    sharpness = [frame_quality.sharpness(grey) for grey in blurred]
    blur = [frame_quality.blur(grey) for grey in blurred]
    assert sharpness == sorted(sharpness, reverse=True)
    assert blur == sorted(blur)
    assert blur[0] < frame_quality.BLURRED < blur[-1]


def test_motion_blur_in_one_direction_counts(textured):
    smeared = cv2.blur(textured, (25, 1))
    assert frame_quality.blur(smeared) > 1.5 * frame_quality.blur(textured)


def test_flat_image_is_blurred_and_not_a_division_by_zero():
    assert frame_quality.blur(np.full((50, 50), 128, np.uint8)) == 1.0
    assert frame_quality.sharpness(np.zeros((50, 50), np.uint8)) == 0.0


def test_displacement_is_the_shift(textured):
    moved = np.roll(textured, 8, axis=1)
    assert frame_quality.measure_displacement(textured, moved) == pytest.approx(8 / 320, rel=0.05)
    assert frame_quality.measure_displacement(textured, textured) < 1e-4


def test_displacement_of_unrelated_or_flat_pictures_is_unknown(textured):
    flat = np.zeros_like(textured)
    assert np.isnan(frame_quality.measure_displacement(flat, textured))


def test_still_camera_needs_evidence():
    assert frame_quality.stands_still((0.0, 0.0005, 0.0, 0.001))
    assert not frame_quality.stands_still((0.0, 0.0, 0.0, 0.02))
    assert not frame_quality.stands_still((float("nan"), float("nan"), 0.0))
    assert not frame_quality.stands_still(())


def test_concerns():
    assert frame_quality.quality_flags(0.2, 0.8, 0.01) == {}
    assert set(frame_quality.quality_flags(0.9, 0.02, 0.6)) == {"blurred", "underexposed", "overexposed"}


def test_exposure_counts_black_and_white():
    grey = np.repeat(np.array([0, 128, 255, 255], np.uint8), 25).reshape(10, 10)
    luminance, highlight, black, white = frame_quality.measure_exposure(grey)
    assert (luminance, highlight, black, white) == (pytest.approx(0.6255, abs=1e-3), 1.0, 0.25, 0.5)


def test_dark_is_what_has_nothing_bright():
    """A room two stops too dark hides twigs; a black cloth behind a plant in good light does not."""
    rng = np.random.default_rng(0)
    room = rng.normal(110, 40, (200, 300)).clip(5, 215)
    linear = (room / 255) ** 2.2
    dim = (255 * (linear / 4) ** (1 / 2.2)).astype(np.uint8)
    cloth = rng.normal(12, 4, (200, 300)).clip(0, 255)
    cloth[80:110, 100:160] = 200  # bolls: 3 % of the image
    for grey, concerns in ((room, set()), (dim, {"underexposed"}), (cloth, set())):
        highlight = frame_quality.measure_exposure(grey.astype(np.uint8))[1]
        assert set(frame_quality.quality_flags(0.2, highlight, 0.0)) == concerns


def test_spread_indices():
    assert frame_quality.spread_indices(5, 10) == [0, 1, 2, 3, 4]
    assert frame_quality.spread_indices(10, 4) == [0, 2, 5, 7]


def test_blank_and_repeated_frames_are_told_apart(textured):
    black, white, other = np.zeros_like(textured), np.full_like(textured, 255), textured[:, ::-1].copy()
    frames = [textured, textured, other, black, black, white, textured, other, textured, other, textured]
    contrasts = np.array([frame_quality.contrast(frame) for frame in frames])
    changes = np.array(
        [frame_quality.change(before, frame) for before, frame in zip([None, *frames], frames, strict=False)]
    )
    blank, repeated = frame_quality.find_blank_and_repeated(contrasts, changes)
    assert np.flatnonzero(blank).tolist() == [3, 4, 5]
    assert np.flatnonzero(repeated).tolist() == [1]


def test_noise_is_no_repetition_and_a_still_camera_repeats_nothing(textured):
    rng = np.random.default_rng(0)
    noisy = [(textured + rng.integers(-2, 3, textured.shape)).clip(0, 255).astype(np.uint8) for _ in range(9)]
    changes = np.array([frame_quality.change(a, b) for a, b in zip([None, *noisy], noisy, strict=False)])
    for changed in (changes, np.where(np.isinf(changes), changes, 0.0)):
        assert not frame_quality.find_blank_and_repeated(np.full(9, 40.0), changed)[1].any()
