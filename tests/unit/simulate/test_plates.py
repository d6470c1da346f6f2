# SPDX-License-Identifier: Apache-2.0
"""Plates: linear in their lights, labelled, the same from a file."""

import numpy as np

from cotton3dg.core.training_picture import CLASSES, LINT
from cotton3dg.simulate import plates as plates_module
from cotton3dg.simulate.plates import LIGHTS, load_plates, save_plates


def test_light_that_is_spread_stays_within_its_boll_and_is_as_much_as_before():
    rng = np.random.default_rng(2)
    arriving, bolls = rng.uniform(0, 1, (LIGHTS, 60)).astype(np.float32), np.repeat([0, 1, 2], 20)
    spread = plates_module.spread_light(arriving, bolls, 0.5)
    np.testing.assert_array_equal(spread[:, bolls == 0], arriving[:, bolls == 0])
    for number in (1, 2):
        before, after = arriving[:, bolls == number], spread[:, bolls == number]
        np.testing.assert_allclose(after.mean(axis=1), before.mean(axis=1), rtol=1e-5)
        np.testing.assert_allclose(after.std(axis=1), 0.5 * before.std(axis=1), rtol=1e-4)


def test_plates_are_linear_in_their_lights(few_plates):
    plate = few_plates[0]
    assert plate.light.shape == (LIGHTS, 96, 96, 3)
    one, two = np.eye(LIGHTS, dtype=np.float32)[:2, :, None] * np.array([1.0, 0.8, 0.5], np.float32)
    np.testing.assert_allclose(plate.lit(one + 2 * two), plate.lit(one) + 2 * plate.lit(two), rtol=1e-4, atol=1e-5)


def test_plates_are_labelled_where_something_is_seen(few_plates):
    assert any((plate.ids > 0).any() for plate in few_plates)
    for plate in few_plates:
        assert (plate.classes[plate.ids > 0] == LINT).all()
        assert (plate.classes < len(CLASSES)).all()
        assert (plate.cover[plate.classes > 0] > 0).all()
        assert len(plate.centres_px) == len(plate.diameters_px)
        for boll in np.unique(plate.ids[plate.ids > 0]):
            rows, columns = np.nonzero(plate.ids == boll)
            far = np.linalg.norm(plate.centres_px[boll - 1] - np.stack([columns, rows], 1), axis=1)
            assert far.min() < 2.5 * plate.diameters_px[boll - 1]


def test_plates_survive_a_file(few_plates, tmp_path):
    save_plates(tmp_path / "scene", few_plates)
    for plate, again in zip(few_plates, load_plates(tmp_path / "scene"), strict=True):
        np.testing.assert_array_equal(plate.light, again.light)
        np.testing.assert_array_equal(plate.ids, again.ids)
        np.testing.assert_array_equal(plate.centres_px, again.centres_px)
