# SPDX-License-Identifier: Apache-2.0
"""Thickness of wood, from the silhouette of its Gaussians."""

import numpy as np
import pytest
from scenes.branch_scene import line

from cotton3dg.core.scene import Gaussians
from cotton3dg.plant_map.radii import radii_of


@pytest.mark.parametrize("opaque", [0.5, 0.36])
@pytest.mark.parametrize("radius", [0.75, 0.2])
def test_thickness_is_that_of_the_silhouette(radius, opaque):
    opacity = 0.9
    # One long needle falls to an opacity at its width over sqrt(2 ln (its own / that)).
    sigma = radius / np.sqrt(2 * np.log(opacity / opaque))
    gaussians = Gaussians(
        np.float32([[0, 0, 10]]),
        np.float32([[1, 0, 0, 0]]),
        np.log(np.float32([[sigma, sigma, 300]])),
        np.float32([np.log(opacity / (1 - opacity))]),
        np.zeros((1, 1, 3), np.float32),
    )
    (radii,) = radii_of([line((0, 0, 9.2), (0, 0, 10.8))], gaussians, np.eye(3), np.zeros(3), opaque)
    assert np.nanmedian(radii) == pytest.approx(radius, abs=0.01)


def test_no_gaussians_have_no_thickness():
    none = Gaussians(*(np.zeros(shape, np.float32) for shape in ((0, 3), (0, 4), (0, 3), (0,), (0, 1, 3))))
    (radii,) = radii_of([line((0, 0, 0), (0, 0, 10))], none, np.eye(3), np.zeros(3), 0.5)
    assert np.isnan(radii).all()
