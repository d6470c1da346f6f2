# SPDX-License-Identifier: Apache-2.0
"""The card's patches in photos under several lights, and the colours that they make of grey levels."""

import cv2
import numpy as np
import pytest
from scenes.card_scene import card_photo, card_sheet

from cotton3dg.core.card import PATCH_LEVELS, PATCHES_CM, printed_reflectance
from cotton3dg.scale.card import CARD_MARKERS, read_patches
from cotton3dg.scale.markers import find_markers
from cotton3dg.traits.lint_colour import (
    Calibration,
    boll_colour,
    calibrate,
    cielab,
    mask_reflectance,
    plant_colour,
    reflectance_and_yellowness,
)

# As card_scene prints them.
PRINTED = 0.04 + 0.82 * (np.array(PATCH_LEVELS) / 255) ** 2.2
LIGHTS = {
    "neutral": ((1.0, 1.0), (1.0, 1.0), (1.0, 1.0)),
    "incandescent, falling off across the card": ((1.05, 0.75), (0.80, 0.57), (0.50, 0.36)),
    "shade": ((0.42, 0.50), (0.50, 0.60), (0.66, 0.79)),
}  # fmt: skip


def colour_photo(light, code_px=110.0, hidden=0.0, sheet=None, **how):
    """(H, W, 3) of a card whose three channels have a light of their own, at the left and at the right edge."""
    sheet = card_sheet("NC26-017", 20) if sheet is None else sheet
    return np.stack(
        [
            card_photo(sheet, code_px, light=each, hidden=hidden, noise=2.0, blur_px=0.6, seed=3, **how)
            for each in light
        ],
        axis=2,
    )


def patches_of(photo):
    return read_patches(photo, find_markers(photo, CARD_MARKERS))


def delta_e(a, b):
    """CIE 1976."""
    return np.linalg.norm(cielab(a) - cielab(b), axis=-1)


@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize(("tilt_deg", "turn_deg"), [(0, 0), (45, 130), (62, 250)])
def test_colours_under_three_lights(light, tilt_deg, turn_deg):
    """Each level as it is told by the other five: none is compared with itself."""
    levels = patches_of(colour_photo(light, tilt_deg=tilt_deg, turn_deg=turn_deg))
    true = np.repeat(PRINTED[:, None], 3, axis=1)
    for left_out in range(1, len(levels) - 1):
        known = np.arange(len(levels)) != left_out
        calibration = calibrate(levels[known], PRINTED[known])
        assert delta_e(calibration.reflectance(levels[left_out]), true[left_out]) < 2
    whole = calibrate(levels, PRINTED)
    assert (delta_e(whole.reflectance(levels), true) < 0.5).all()


@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
def test_lint_beside_the_card_under_three_lights(light):
    """A field of the colour of lint, painted over the notes of the card."""
    lint = np.array([0.72, 0.69, 0.62])
    sheets = []
    for channel in lint:
        # The level that card_scene prints with this reflectance.
        level = round(255 * ((channel - 0.04) / 0.82) ** (1 / 2.2))
        sheet = card_sheet("NC26-017", 20)
        sheet[20 * 22 : 20 * 25, 20 * 8 : 20 * 13] = level
        sheets.append(sheet)
    # The middle of the light's fall, as the card's own middle.
    flat = [(np.mean(each),) * 2 for each in light]
    photo = np.concatenate(
        [colour_photo([each], sheet=sheet) for each, sheet in zip(flat, sheets, strict=True)], axis=2
    )
    calibration = calibrate(patches_of(photo), PRINTED)
    near = (np.abs(calibration.reflectance(photo) - lint) < 0.06).all(axis=2)
    inside = cv2.erode(near.astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool)
    assert inside.sum() > 100
    found = mask_reflectance(photo, inside, calibration)
    assert delta_e(found, lint) < 2


def test_a_burnt_out_level_is_left_out_and_the_rest_tells_it():
    levels = patches_of(colour_photo(((1.25, 1.25), (1.2, 1.2), (1.15, 1.15))))
    assert np.isnan(levels[0]).all()
    assert np.isfinite(levels[1:]).all()
    calibration = calibrate(levels, PRINTED)
    # Brighter than all that is known: straight on.
    top = 255 * (np.array([1.25, 1.2, 1.15]) * PRINTED[0]).clip(0, 1) ** (1 / 2.2)
    assert delta_e(calibration.reflectance(top), np.full(3, PRINTED[0])) < 4


def test_what_is_no_card():
    clutter = colour_photo(LIGHTS["neutral"], sheet=np.full((594, 420), 110, np.uint8))
    assert patches_of(clutter) is None
    assert patches_of(colour_photo(LIGHTS["neutral"], code_px=40, tilt_deg=70)) is None
    covered = card_sheet("NC26-017", 20)
    x, y, w, h = PATCHES_CM[0][0], *PATCHES_CM[1:]
    left, top = (21.0 - 18.6) / 2, (29.7 - 25.9) / 2
    rows = slice(int(20 * (top + y)), int(20 * (top + y + 6 * h)))
    covered[rows, int(20 * (left + x)) : int(20 * (left + x + w))] = 90
    covered[rows, int(20 * (left + PATCHES_CM[0][1])) : int(20 * (left + PATCHES_CM[0][1] + w))] = 90
    assert patches_of(colour_photo(LIGHTS["neutral"], sheet=covered)) is None


def test_calibration_needs_levels_that_fall():
    levels = np.linspace(230, 40, 6)[:, None] * np.ones(3)
    assert isinstance(calibrate(levels, PRINTED), Calibration)
    assert calibrate(levels[::-1], PRINTED) is None
    levels[:4] = np.nan
    assert calibrate(levels, PRINTED) is None


def test_cielab_of_known_colours():
    """IEC 61966-2-1 primaries as published by Lindbloom, and neutrals."""
    np.testing.assert_allclose(cielab(np.array([1.0, 0, 0])), [53.2408, 80.0925, 67.2032], atol=0.02)
    np.testing.assert_allclose(cielab(np.array([0.0, 0, 1])), [32.2970, 79.1875, -107.8602], atol=0.02)
    np.testing.assert_allclose(cielab(np.full(3, 0.5)), [76.0693, 0, 0], atol=1e-3)


def test_rd_and_plus_b_by_hand():
    """Greys have no yellowness. Y = 70, Z/Zn = 0.6 under C: 70 * 0.51 * (21 + 14) / (1 + 14) * 0.1 = 8.33."""
    rd, b = reflectance_and_yellowness(np.full(3, 0.7))
    assert (rd, b) == (pytest.approx(70.0), pytest.approx(0.0, abs=0.01))
    # A colour whose XYZ under C is that: back through the adaptation.
    from cotton3dg.traits.lint_colour import BRADFORD, WHITE_C, WHITE_D65, XYZ_OF_SRGB

    xyz_c = np.array([0.7, 0.7, 0.6]) * WHITE_C
    cones = (BRADFORD @ WHITE_D65) / (BRADFORD @ WHITE_C)
    xyz_d65 = np.linalg.inv(BRADFORD) @ (cones * (BRADFORD @ xyz_c))
    rd, b = reflectance_and_yellowness(np.linalg.inv(XYZ_OF_SRGB) @ xyz_d65)
    assert (rd, b) == (pytest.approx(70.0), pytest.approx(8.33, abs=0.01))


def test_colour_of_a_boll_is_the_median_of_its_views():
    grey = [np.full(3, value) for value in (0.6, 0.7, 0.9)]
    colour = boll_colour(grey)
    assert colour.lint_rd_pct == pytest.approx(70)
    assert colour.lint_colour_views == 3
    few = boll_colour(grey[:2])
    assert np.isnan(few.lint_cie_l)
    assert few.lint_colour_views is None
    plant = plant_colour([grey, [np.full(3, 0.5)] * 3, grey[:1]])
    assert plant.lint_rd_pct == pytest.approx(60)
    assert np.isnan(plant_colour([]).lint_cie_l)


def test_burnt_out_or_tiny_masks_say_nothing():
    calibration = calibrate(np.linspace(230, 40, 6)[:, None] * np.ones(3), PRINTED)
    photo, mask = np.full((40, 40, 3), 200, np.uint8), np.zeros((40, 40), bool)
    mask[10:20, 10:20] = True
    expected = calibration.reflectance(np.full(3, 200.0))
    np.testing.assert_allclose(mask_reflectance(photo, mask, calibration), expected)
    photo[12:14, 12:18] = 255
    assert mask_reflectance(photo, mask, calibration) is None
    assert mask_reflectance(photo, np.zeros((40, 40), bool), calibration) is None


def test_usual_print():
    np.testing.assert_allclose(printed_reflectance(np.array([255, 0])), [0.86, 0.04], atol=1e-6)
