# SPDX-License-Identifier: Apache-2.0
"""Fruiting positions: bolls on branches whose bends are known."""

import numpy as np
import pytest
from scenes.branch_scene import line, zigzag

from cotton3dg.geometry.polylines import place_at
from cotton3dg.plant_map.positions import infer_positions

UP = np.array([0.2, -0.1, 1.0]) / np.linalg.norm([0.2, -0.1, 1.0])


def feet_over(curve, nodes_cm):
    """Feet of bolls on stalks of 2.5 cm that rise from a branch."""
    return np.array([place_at(curve, node) + 2.5 * UP for node in nodes_cm])


@pytest.mark.parametrize(("site", "position"), [(0, 1), (1, 2), (2, 3), (3, 3)])
def test_positions_count_the_kinks_before_a_boll(site, position):
    lengths = (8, 5.6, 3.9, 2.8)
    curve = line(*zigzag((0, 0, 0), 0.3, 0.6, (*lengths, 2.0)))
    node_cm = float(sum(lengths[: site + 1]))
    (sited,) = infer_positions(curve, [node_cm], feet_over(curve, [node_cm]), 0.0, True)
    assert sited.position == position
    assert sited.confidence > 0.5


@pytest.mark.parametrize("beyond_cm", [0.0, 1.7, -1.0])
def test_a_boll_sits_at_the_bend_though_its_stalk_seems_to_leave_beside_it(beyond_cm):
    curve = line(*zigzag((0, 0, 0), 0.3, 0.6, (8, 5.6, 3.9, 2.0)))
    nodes_cm = [8.0, 13.6]
    seen_cm = [8.0 + beyond_cm, 13.6]
    sited = infer_positions(curve, seen_cm, feet_over(curve, nodes_cm), 0.0, True)
    assert [site.position for site in sited] == [1, 2]
    assert [site.path_cm for site in sited] == seen_cm


def test_positions_grow_outwards():
    # Two bolls so far out that each alone may be anywhere.
    curve = line((0, 0, 0), (32, 0, 8))
    nodes_cm = [10.0, 19.0, 30.0]
    sited = infer_positions(curve, nodes_cm, feet_over(curve, nodes_cm), 0.0, True)
    positions = [site.position for site in sited]
    assert positions == sorted(positions)
    assert len(set(positions) - {3}) == sum(position < 3 for position in positions)


def test_positions_of_vegetative_branches_are_not_inferred():
    curve = line((0, 0, 0), (10, 0, 20))
    (sited,) = infer_positions(curve, [8.0], feet_over(curve, [8.0]), 0.0, False)
    assert sited.position == 0
