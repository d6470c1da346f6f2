# SPDX-License-Identifier: Apache-2.0
"""Lengths and places along polylines."""

import numpy as np
import pytest

from cotton3dg.geometry.polylines import nearest_on, path_lengths, piece_between, place_at, resampled, smoothed


def test_lengths_and_places_along_a_polyline():
    points = np.array([[0, 0, 0], [3, 0, 0], [3, 4, 0.0]])
    assert path_lengths(points).tolist() == [0, 3, 7]
    assert place_at(points, 5.0) == pytest.approx([3, 2, 0])
    away, station = nearest_on(points, np.array([[1, 1, 0], [5, 4, 0.0]]))
    assert away == pytest.approx([1, 2])
    assert station == pytest.approx([1, 7])
    places = np.random.default_rng(0).uniform(-3, 7, (500, 3))
    (away, station), (near, its_station) = nearest_on(points, places), nearest_on(points, places, 2.0)
    assert (near[away < 2] == away[away < 2]).all() and (its_station[away < 2] == station[away < 2]).all()
    assert (near[away >= 2] >= 2).all() and np.isinf(near).any()
    even = resampled(points, 0.5)
    assert np.allclose(np.linalg.norm(np.diff(even, axis=0), axis=1), 0.5)
    assert smoothed(even, 2.0)[[0, -1]] == pytest.approx(even[[0, -1]])


def test_a_piece_has_the_points_around_it_and_may_run_backwards():
    points = np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)])
    assert piece_between(points, 1.0, 3.0)[:, 0].tolist() == [1, 2, 3]
    assert piece_between(points, 1.5, 2.5)[:, 0].tolist() == [1, 2, 3]
    assert piece_between(points, 3.0, 1.0)[:, 0].tolist() == [3, 2, 1]
    assert len(piece_between(points, 2.0, 2.0)) == 2, "a piece has a direction"
