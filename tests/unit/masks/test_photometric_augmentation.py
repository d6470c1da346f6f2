# SPDX-License-Identifier: Apache-2.0
"""Augmented pictures differ in light and colour, and in nothing else."""

import numpy as np

from cotton3dg.core.training_picture import TrainingPicture
from cotton3dg.masks.photometric_augmentation import augment


def picture() -> TrainingPicture:
    """A bright and a dark half, with colour."""
    image = np.full((96, 96, 3), (180, 150, 90), np.uint8)
    image[:, 48:] = (40, 60, 30)
    ids = np.zeros((96, 96), np.uint16)
    ids[20:60, 10:40] = 1
    return TrainingPicture(image, (ids > 0).astype(np.uint8), ids, np.array([[25, 40]]), np.array([35.0]))


def test_labels_and_shapes_stay_and_a_seed_is_a_picture():
    before = picture()
    for seed in range(20):
        after, again = (augment(np.random.default_rng(seed), before) for _ in range(2))
        np.testing.assert_array_equal(after.image, again.image)
        assert after.image.shape == before.image.shape and after.image.dtype == np.uint8
        assert after.ids is before.ids and after.classes is before.classes
        assert after.image[:, :40].mean() > after.image[:, 56:].mean() - 20, "the bright half stays the brighter"


def test_light_and_colours_differ_from_picture_to_picture():
    images = np.stack([augment(np.random.default_rng(seed), picture()).image for seed in range(40)]).astype(float)
    means = images.mean(axis=(1, 2))
    assert means.mean(axis=1).std() > 10, "brightness"
    assert (means[:, 0] - means[:, 2]).std() > 10, "saturation"
    left = images[:, :, :48].mean(axis=3)
    assert (left.std(axis=(1, 2)) > 15).mean() > 0.15, "dappled light, within what was one colour"
    assert (left.std(axis=(1, 2)) < 1).mean() > 0.3, "many pictures keep an even light"
