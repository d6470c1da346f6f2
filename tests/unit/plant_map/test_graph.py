# SPDX-License-Identifier: Apache-2.0
"""The graph of places of wood: what is joined, and the shortest paths in it."""

import numpy as np
import pytest

from cotton3dg.plant_map.graph import joined, shortest_paths


def test_parts_are_joined_with_the_nearest_of_others_whatever_their_size():
    rng = np.random.default_rng(3)
    crowd = rng.normal(0, 0.4, (150, 3))
    spots = np.array([[5, 0, 0], [5.5, 0, 0], [9, 0, 0], [0, 30, 0.0]])
    places = np.vstack([crowd, spots])
    pairs = {tuple(pair) for pair in joined(places).pairs}
    nearest = int(np.argmin(np.linalg.norm(crowd - spots[0], axis=1)))
    assert (nearest, 150) in pairs
    assert (151, 152) in pairs
    assert not any(153 in pair for pair in pairs), "too far for a bridge"


def test_shortest_paths_go_around_what_is_dear_and_through_no_foot():
    straight = np.column_stack([np.zeros(21), np.zeros(21), np.arange(21) * 0.5])
    feet = np.array([[0.4, 0, 5.0]])
    tree = shortest_paths(joined(straight), np.zeros(21, bool), 0, feet)
    assert tree.lengths[20] == pytest.approx(10)
    assert tree.before[21] in (9, 10, 11)
    assert 21 not in tree.before
