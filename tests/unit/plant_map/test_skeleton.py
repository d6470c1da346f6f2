# SPDX-License-Identifier: Apache-2.0
"""Ways through the wood: what is too little for one, and where a blade begins."""

import numpy as np
import pytest
from scenes.branch_scene import line

from cotton3dg.plant_map.skeleton import FEWEST_PLACES, bare_length, extract_axes
from cotton3dg.plant_map.wood import WoodCloud


@pytest.mark.parametrize("n", [FEWEST_PLACES - 1, FEWEST_PLACES])
def test_a_handful_of_places_has_no_stem(n):
    places = np.column_stack([np.zeros((n, 2)), np.arange(n, dtype=float)])
    cloud = WoodCloud(places, np.zeros(n, bool), np.zeros(n, np.int64), np.ones(n, bool), ())
    axes, _ = extract_axes(cloud)
    assert len(axes) == (n >= FEWEST_PLACES)


def test_a_blade_that_ends_thinly_begins_where_its_stalk_ends():
    """A way ran along a leaf's rim twice, and two places lay past its tip: as half of it was no blade, the whole leaf
    was the lowest branch."""
    curve = line((0, 0, 0), (12.8, 0, 0))
    places = [(x, 0, 0) for x in np.arange(0.05, 6, 0.1)]
    for start, beside in zip(range(6, 12), (0.9, 0.6, 0.3, 0.9, 0.7, 0.3), strict=True):
        across = np.where(np.arange(50) < 50 * beside, 1.0, 0.0)
        places += [(start + (k + 0.5) / 50, y, 0) for k, y in enumerate(across)]
    places += [(12.2, 0, 0), (12.4, 0, 0)]
    assert bare_length(curve, np.array(places)) == 6.0
    assert bare_length(curve, np.array(places[:60])) == np.inf, "nothing but a stalk"
