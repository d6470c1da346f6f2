# SPDX-License-Identifier: Apache-2.0
"""Height and canopy of what is known to be the plant."""

import re

import numpy as np
import pytest
from scenes.measured_plant import SCALE
from scenes.table_scene import (
    BOLL_RADIUS_CM,
    BOLLS_CM,
    POSE,
    gaussians_at,
    plant_scene,
)

from cotton3dg.core.columns import columns_of
from cotton3dg.core.measurements import PlantTraits
from cotton3dg.traits.measure import summarise_plant
from cotton3dg.traits.plant_segmentation import Plant, isolate_plant
from cotton3dg.traits.plant_size import measure_places, measure_silhouette


def test_height_and_canopy_of_the_plant():
    gaussians, labels = plant_scene()
    plant = isolate_plant(gaussians, SCALE, 4.0, labels > 0)
    size = measure_silhouette(gaussians, plant, SCALE)
    assert size.height_cm == pytest.approx(70.0, abs=0.3)
    # Bolls stick out to 31 cm in x and y, turned against each other.
    surface = BOLLS_CM[:, :2]
    spread = np.ptp(surface, axis=0) + 2 * BOLL_RADIUS_CM
    assert (size.length_cm + size.width_cm) / 2 == pytest.approx(spread.mean(), rel=0.15)
    assert size.length_cm >= size.width_cm
    assert size.height_obb_cm > 55


@pytest.mark.parametrize(
    ("below_cm", "unsure_cm", "turned_cm"), [(0.1, 0.0, 30.05), (0.5, 0.0, None), (0.5, 1.0, 30.25)]
)
def test_a_canopy_is_perhaps_that_of_another_rectangle(below_cm, unsure_cm, turned_cm):
    """Around a half square and a little more the least is a square; one that is long is hardly larger."""
    corners = np.array([[-20, 0], [20, 0], [0, 20], [0, -below_cm]])
    places = np.vstack([np.column_stack([corners, np.full(4, z)]) for z in (20.0, 40.0)])
    size = measure_places(places, places[:, 2], places, unsure_cm)
    assert size.canopy_cm == pytest.approx(20 * 2**0.5)
    assert size.turned_canopy_cm == pytest.approx(turned_cm or size.canopy_cm, abs=0.02)
    row = summarise_plant([], size, SCALE, 0.0)
    assert row.canopy_size_error_cm == pytest.approx(
        np.hypot(row.canopy_size_cm * SCALE.relative_error, size.turned_canopy_cm - size.canopy_cm)
    )


def test_a_line_of_points_has_a_height_and_no_canopy():
    line = np.column_stack([np.zeros((5, 2)), np.linspace(10, 50, 5)])
    size = measure_places(line, line[:, 2], line)
    assert (size.height_cm, size.canopy_cm, size.turned_canopy_cm) == (40, 0, 0)


def test_the_height_is_what_its_description_says():
    """A cloud of known balls, lying along the table's long side, one higher than the other."""
    (described,) = [one.description for one in columns_of(PlantTraits) if one.name == "plant_height_cm"]
    words = re.search(r"second-highest Gaussian ends, at an opacity of ([\d.]+)", described)
    assert words
    opacity, sigma_cm, tops_cm = 0.8, 0.5, np.array([30.0, 42, 40, 25, 44, 10, 5])
    places = np.column_stack([np.linspace(-20, 20, len(tops_cm)), np.zeros(len(tops_cm)), tops_cm])
    cloud = gaussians_at(places, sigma_cm, opacity=opacity)
    every = np.ones(len(cloud), bool)
    plant = Plant(every, POSE.scene(np.zeros((1, 3)))[0], stem_found=True, apart=~every)
    size = measure_silhouette(cloud, plant, SCALE)
    reach_cm = sigma_cm * np.sqrt(2 * np.log(opacity / float(words[1])))
    # The highest of the points on an ellipsoid lies a little below its top.
    assert size.height_cm == pytest.approx(42 + reach_cm, abs=0.05 * reach_cm)
