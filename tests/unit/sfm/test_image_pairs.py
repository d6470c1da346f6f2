# SPDX-License-Identifier: Apache-2.0
"""Pairs to match."""

import pytest

from cotton3dg.sfm.image_pairs import choose_pairs


def test_ordered_pairs_close_the_ring():
    pairs = choose_pairs(100, 8, ordered=True)
    assert (0, 99) in pairs and (0, 1) in pairs and (1, 98) in pairs
    assert all(0 <= i < j < 100 for i, j in pairs)
    assert len(set(pairs)) == len(pairs) < 900


def test_every_image_has_neighbours_on_both_sides():
    degree = [sum(k in (i, j) for i, j in choose_pairs(100, 8, ordered=True)) for k in range(100)]
    assert min(degree) == 16


def test_a_second_turn_is_tied_to_the_first():
    """Two turns in 100 frames: each half of the second turn has a pair that looks at the same side."""
    pairs = choose_pairs(100, 8, ordered=True)
    tied = {j // 10 for i, j in pairs if abs(j - i - 50) <= 4}
    assert tied >= {5, 6, 7, 8, 9}


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_few_images_give_each_pair_once(n):
    pairs = choose_pairs(n, 8, ordered=True)
    assert len(pairs) == len(set(pairs)) == n * (n - 1) // 2


def test_unordered_images_give_all_pairs_unless_very_many():
    assert len(choose_pairs(200, 8, ordered=False)) == 200 * 199 // 2
    assert len(choose_pairs(400, 8, ordered=False)) < 10_000
