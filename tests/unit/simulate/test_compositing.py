# SPDX-License-Identifier: Apache-2.0
"""Pictures put together from plates: the same for the same number, true to their labels."""

import numpy as np
import pytest

from cotton3dg.core.training_picture import CLASSES, LINT, UNKNOWN
from cotton3dg.simulate.compositing import Layer, classes_in_blur, compose, draw_power


@pytest.fixture(scope="module")
def backgrounds():
    return np.random.default_rng(0).integers(0, 256, (2, 128, 128, 3), np.uint8)


def test_some_pictures_are_lit_by_little_but_the_sun_and_their_shade_is_blue():
    powers = [draw_power(np.random.default_rng(number)) for number in range(200)]
    brightness = np.array([power.mean(axis=1) for power in powers])
    hard = (brightness[:, 1] == 0) & (brightness[:, 2] < 0.5 * brightness[:, 0])
    assert 0.2 < hard.mean() < 0.5
    blueness = np.array([np.log(power[2, 2] / power[2, 0]) - np.log(power[0, 2] / power[0, 0]) for power in powers])
    assert np.median(blueness[hard]) > np.median(blueness[~hard]) + 0.1


def test_a_number_is_a_picture_and_its_labels_fit(few_plates, backgrounds):
    seen = 0
    for number in range(20):
        picture, again = (compose(np.random.default_rng(number), few_plates, backgrounds, 64) for _ in range(2))
        np.testing.assert_array_equal(picture.image, again.image)
        np.testing.assert_array_equal(picture.ids, again.ids)
        assert picture.image.shape == (64, 64, 3) and picture.image.dtype == np.uint8
        assert (picture.classes[picture.ids > 0] == LINT).all()
        assert set(np.unique(picture.classes)) <= {*range(len(CLASSES)), UNKNOWN}
        assert picture.ids.max() <= len(picture.centres_px) == len(picture.diameters_px)
        seen += bool((picture.ids > 0).any())
    assert seen > 5


def test_blur_hides_small_bolls_and_not_large_ones():
    classes = np.array([[LINT, LINT, CLASSES.index("bur"), LINT]], np.uint8)
    ids = np.array([[1, 2, 0, 2]], np.uint16)
    nothing = np.zeros((1, 4), np.float32)
    layer = Layer(nothing, nothing, classes, ids, np.zeros((2, 2), np.float32), np.array([20.0, 200.0], np.float32))
    np.testing.assert_array_equal(classes_in_blur(layer, 0.0), classes)
    np.testing.assert_array_equal(classes_in_blur(layer, 4.0), [[UNKNOWN, LINT, classes[0, 2], LINT]])
    np.testing.assert_array_equal(classes_in_blur(layer, 12.0), [[UNKNOWN, UNKNOWN, classes[0, 2], UNKNOWN]])


def test_a_picture_moves_its_middles_with_its_bolls(few_plates, backgrounds):
    """The way from a boll's pixels to its middle is as long, in diameters, as in the plate that it comes from."""
    ways = []
    for number in range(40):
        picture = compose(np.random.default_rng(number), few_plates, backgrounds, 64)
        for boll in np.unique(picture.ids[picture.ids > 0]):
            rows, columns = np.nonzero(picture.ids == boll)
            middle = np.array([columns.mean() + 0.5, rows.mean() + 0.5])
            way = np.linalg.norm(picture.centres_px[boll - 1] - middle) / picture.diameters_px[boll - 1]
            if len(rows) > 0.4 * picture.diameters_px[boll - 1] ** 2:
                ways.append(way)
    assert len(ways) > 5 and np.median(ways) < 0.3
