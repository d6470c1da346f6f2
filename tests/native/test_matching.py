# SPDX-License-Identifier: Apache-2.0
"""Nearest neighbours among descriptors: exact, on every instruction set."""

from __future__ import annotations

import matching
import numpy as np
import pytest

from cotton3dg import _native


@pytest.mark.parametrize("rows", [(1, 1), (1, 2), (2, 1), (31, 33), (70, 45), (64, 96), (130, 257)])
@pytest.mark.parametrize("numbers", [128, 7, 1])
def test_neighbours_are_exact(instruction_set, rows, numbers) -> None:
    rng = np.random.default_rng([*rows, numbers])
    a, b = (rng.integers(0, 256, (n, numbers), np.uint8) for n in rows)
    of_a, of_b = _native.match_descriptors(a, b)
    np.testing.assert_array_equal(of_a, matching.best_two(a, b))
    np.testing.assert_array_equal(of_b, matching.best_two(b, a))


def test_of_equals_the_first_is_named_and_the_next_is_as_good(instruction_set) -> None:
    a = np.random.default_rng(0).integers(0, 256, (3, 128), np.uint8)
    b = np.repeat(a, 40, axis=0)
    of_a, of_b = _native.match_descriptors(a, b)
    np.testing.assert_array_equal(of_a, matching.best_two(a, b))
    np.testing.assert_array_equal(of_a[0], of_a[1])
    np.testing.assert_array_equal(of_b, matching.best_two(b, a))


def test_the_largest_numbers_do_not_overflow(instruction_set) -> None:
    a = np.full((5, 32768), 255, np.uint8)
    of_a, _ = _native.match_descriptors(a, a)
    assert (of_a[0] == 255 * 255 * 32768).all()
    with pytest.raises(ValueError, match="at most 32768"):
        _native.match_descriptors(np.zeros((1, 32769), np.uint8), np.zeros((1, 32769), np.uint8))


@pytest.mark.parametrize("rows", [(0, 0), (0, 5), (5, 0)])
def test_nothing_has_no_neighbour(instruction_set, rows) -> None:
    a, b = (np.ones((n, 128), np.uint8) for n in rows)
    of_a, of_b = _native.match_descriptors(a, b)
    assert of_a.shape == (3, rows[0]) and of_b.shape == (3, rows[1])
    assert (of_a == -1).all() and (of_b == -1).all()


def test_what_is_no_descriptor_is_refused() -> None:
    good = np.zeros((4, 128), np.uint8)
    with pytest.raises(TypeError, match="uint8"):
        _native.match_descriptors(good.astype(np.float32), good)
    with pytest.raises(ValueError, match="shape"):
        _native.match_descriptors(good, np.zeros((4, 64), np.uint8))
