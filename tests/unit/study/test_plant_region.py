# SPDX-License-Identifier: Apache-2.0
"""The plant's pixels that a study judges models by."""

import cv2
import numpy as np
import pytest

from cotton3dg.core.network_maps import Maps
from cotton3dg.core.scene import Camera
from cotton3dg.gaussians.views import View
from cotton3dg.study import plant_region
from cotton3dg.study.plant_region import PlantRegions, find_plant_region, resized


class White:
    """A network that takes what is white for lint, and what is grey for wood that it is not sure of."""

    seen = 0

    def maps(self, image: np.ndarray) -> Maps:
        self.seen += 1
        small = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)[..., 0]
        plant = np.select([small > 200, small > 100], [0.9, 0.4], 0.1).astype(np.float32)
        probabilities = np.stack([1 - plant, plant, *(0 * plant for _ in range(3))])
        return Maps(probabilities, np.zeros((2, *small.shape)), 0 * plant, 2.0, image.shape[:2])


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> White:
    found = White()
    monkeypatch.setattr(plant_region, "open_bolls", lambda: found)
    return found


def photo() -> np.ndarray:
    image = np.zeros((120, 200, 3), np.uint8)
    image[20:40, 20:40] = 255
    image[60:64, 20:60] = 150
    image[20:40, 150:170] = 255
    return image


def test_the_plant_is_what_looks_like_one_within_the_window(network: White) -> None:
    region = find_plant_region(photo(), (0, 0, 100, 120))
    assert region[20:40, 20:40].all() and region[60:64, 20:60].all()
    assert not region[:, 110:].any() and not region[90:].any()
    # An edge of one or two pixels at each side belongs to it: the network's maps are of half the image's size.
    assert 22 * 22 + 6 * 42 <= region.sum() <= 24 * 24 + 8 * 44
    assert find_plant_region(photo(), None)[20:40, 150:170].all()
    assert not find_plant_region(np.zeros((64, 64, 3), np.uint8), None).any()


def test_a_photo_is_looked_at_once_whatever_model_is_judged(network: White) -> None:
    views = [View(Camera(f"{i}", 200, 120, 200.0, 200.0, 100.0, 60.0, np.eye(3, 4)), photo()) for i in range(3)]
    views[2].image[80:90, 80:90] = 255
    regions = PlantRegions()
    # Without points on a table the whole image is looked at.
    held_out = regions.of_held_out(views, 2, np.zeros((0, 3)))
    again = regions.of_held_out(views, 2, np.zeros((0, 3)))
    assert network.seen == 2 and len(held_out) == 2
    assert all(one is other for one, other in zip(held_out, again, strict=True))
    assert held_out[1][85, 85] and not held_out[0][85, 85]


def test_a_region_at_another_size_keeps_what_it_covers_half_of() -> None:
    region = np.zeros((120, 200), bool)
    region[40:80, 40:83] = True
    small = View(Camera("a", 50, 30, 50.0, 50.0, 25.0, 15.0, np.eye(3, 4)), np.zeros((30, 50, 3), np.uint8))
    expected = np.zeros((30, 50), bool)
    expected[10:20, 10:21] = True
    np.testing.assert_array_equal(resized(region, small), expected)
