# SPDX-License-Identifier: Apache-2.0
"""One image seen at several sizes, taken together."""

import numpy as np
import pytest

from cotton3dg.core.network_maps import Maps, middles_of_pixels
from cotton3dg.core.training_picture import LINT
from cotton3dg.masks.test_time_augmentation import (
    FAMILIAR_PX,
    LOOKS,
    merge_maps,
    mirror,
    predict_with_augmentation,
    sharpen,
)

WIDTH, HEIGHT = 320, 240


def look_at(look: float, diameter_px: float, lint: float) -> Maps:
    """Of an image with one boll in its middle, of a width in px of the full look (one pixel of the image)."""
    scale = 2 / look
    shape = round(HEIGHT / scale), round(WIDTH / scale)
    probabilities = np.full((5, *shape), (1 - lint) / 4, np.float32)
    probabilities[LINT] = lint
    middle = np.array([WIDTH / 2, HEIGHT / 2], np.float32)[:, None, None]
    votes = middle + 0 * middles_of_pixels(shape, scale)
    sizes = np.full(shape, diameter_px, np.float32)
    return Maps(probabilities, votes, sizes, scale, (HEIGHT, WIDTH))


def test_votes_and_sizes_of_all_looks_are_in_pixels_of_the_image():
    mixed = merge_maps([look_at(look, 100, 0.9) for look in LOOKS])
    assert mixed.lint.shape == (HEIGHT / 2, WIDTH / 2)
    assert mixed.scale == 2
    np.testing.assert_allclose(mixed.probabilities.sum(axis=0), 1, atol=1e-5)
    np.testing.assert_allclose(mixed.diameters, 100, rtol=1e-4)
    inside = np.s_[10:-10, 10:-10]  # the outermost pixels of a small look lie in those of a large one
    np.testing.assert_allclose(mixed.votes[0][inside], WIDTH / 2, atol=0.05)
    np.testing.assert_allclose(mixed.votes[1][inside], HEIGHT / 2, atol=0.05)


@pytest.mark.parametrize("best", range(len(LOOKS)))
def test_the_look_in_which_bolls_are_familiar_counts_most(best):
    diameter_px = FAMILIAR_PX / LOOKS[best]
    heard = [
        merge_maps([look_at(look, diameter_px, float(k == only)) for k, look in enumerate(LOOKS)]).lint.mean()
        for only in range(len(LOOKS))
    ]
    assert np.argmax(heard) == best
    assert sum(heard) == pytest.approx(1, abs=1e-3)


def soft_disc() -> np.ndarray:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    away = np.hypot(x - WIDTH / 2, y - HEIGHT / 2)
    return np.repeat((80 + 100 / (1 + np.exp((away - 50) / 2))).astype(np.uint8)[..., None], 3, axis=2)


def test_sharpening_makes_edges_steeper_and_leaves_the_rest():
    image = soft_disc()
    sharp = sharpen(image)
    steepest = [np.abs(np.diff(shown[HEIGHT // 2, :, 0].astype(int))).max() for shown in (image, sharp)]
    assert steepest[1] > 1.4 * steepest[0]
    assert np.array_equal(sharp[:40], image[:40])
    assert np.array_equal(sharp[HEIGHT // 2, WIDTH // 2], image[HEIGHT // 2, WIDTH // 2])


def test_a_boll_that_the_network_knows_only_sharpened_is_half_known():
    blurred = soft_disc()

    class KnowsWhatIsSharp:
        def maps(self, image, look):
            return look_at(look, 100, 0.9 if np.array_equal(image, sharpen(blurred)[:, ::-1]) else 0.1)

    np.testing.assert_allclose(predict_with_augmentation(blurred, KnowsWhatIsSharp()).lint, 0.5, atol=1e-3)


def test_what_the_mirror_image_shows_is_put_back_where_the_image_has_it():
    x = np.mgrid[: HEIGHT // 2, : WIDTH // 2][1]
    maps = look_at(1.0, 100, 0.9)
    left = np.where(x < 40, np.float32(0.9), np.float32(0.1))
    maps.probabilities[LINT] = left
    maps.votes[:] = np.array([70.0, 90.0], np.float32)[:, None, None]
    maps.diameters[:] = 100 + x
    back = mirror(maps)
    np.testing.assert_array_equal(back.lint, left[:, ::-1])
    assert back.votes[0].max() == back.votes[0].min() == WIDTH - 70
    assert back.votes[1].max() == back.votes[1].min() == 90
    again = mirror(back)
    for name in ("probabilities", "votes", "diameters"):
        np.testing.assert_array_equal(getattr(again, name), getattr(maps, name))
