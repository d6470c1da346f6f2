# SPDX-License-Identifier: Apache-2.0
"""Traits as published, on bodies whose hull and box are known by hand."""

import numpy as np
import pytest
from scenes.measured_plant import SCALE
from scenes.table_scene import POSE, gaussians_at, joined
from scipy.spatial.transform import Rotation

from cotton3dg.core.bolls import BollInstance
from cotton3dg.traits.boll_volume import measure_bolls
from cotton3dg.traits.measure import summarise_plant
from cotton3dg.traits.plant_segmentation import Plant
from cotton3dg.traits.plant_size import measure_silhouette
from cotton3dg.traits.published import box_of_means

FOOT = POSE.scene(np.zeros((1, 3)))[0]


def corners_of(*sides):
    return np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * sides


def test_height_and_canopy_are_sides_of_the_box_of_the_middles():
    """A box of 20 x 10 x 40 cm on the foot: 40 cm high, (20 + 10) / 2 = 15 cm wide."""
    places = corners_of(20.0, 10.0, 40.0) + [0, 0, 20]
    size = box_of_means(places)
    assert size.height_cm == pytest.approx(40)
    assert size.canopy_cm == pytest.approx(15)
    turned = box_of_means(places @ Rotation.from_euler("z", 30, degrees=True).as_matrix().T)
    assert (turned.height_cm, turned.canopy_cm) == pytest.approx((40, 15))


def test_the_foot_belongs_to_the_plant():
    """Middles from 5 cm upwards, where the clamp ends: the box reaches down to the table all the same."""
    stem = np.column_stack([np.zeros((100, 2)), np.linspace(5, 70, 100)])
    assert box_of_means(stem).height_cm == pytest.approx(70)


def test_a_bolls_volume_is_the_hull_of_its_middles():
    """Two bolls, cubes of middles 2 and 3 cm long: 8 and 27 cm³, however wide the Gaussians are."""
    bodies = [gaussians_at(corners_of(side, side, side) + [0, 0, 30 + 5 * side], 0.4) for side in (2.0, 3.0)]
    gaussians = joined(*bodies)
    rows = (np.arange(8), np.arange(8, 16))
    bolls = [BollInstance(k, own, ("a", "b"), gaussians.means[own].mean(0), 0.1, 0.9) for k, own in enumerate(rows, 1)]
    traits = measure_bolls(gaussians, bolls, SCALE, FOOT)
    assert [boll.volume_published_cm3 for boll in traits] == pytest.approx([8, 27], rel=1e-4)
    assert all(boll.volume_cm3 > 1.2 * boll.volume_published_cm3 for boll in traits)
    plant = Plant(np.ones(16, bool), FOOT, True, np.zeros(16, bool))
    row = summarise_plant(traits, measure_silhouette(gaussians, plant, SCALE), SCALE)
    assert row.boll_volume_published_cm3 == pytest.approx(35, rel=1e-4)
    assert row.plant_height_published_cm == pytest.approx(46.5, rel=0.01)
    assert 1 < row.canopy_size_published_cm < 4


def test_bolls_without_a_body_have_no_published_volume():
    gaussians = gaussians_at(np.array([[0, 0, 30.0], [1, 0, 30], [2, 0, 30]]), 0.2)
    boll = BollInstance(1, np.arange(3), ("a",), gaussians.means.mean(0), 0.1, 0.9)
    (traits,) = measure_bolls(gaussians, [boll], SCALE, FOOT)
    assert np.isnan(traits.volume_published_cm3)
    assert np.isnan(summarise_plant([traits], None, SCALE).boll_volume_published_cm3)
