# SPDX-License-Identifier: Apache-2.0
"""How a network's proposals share an image: duplicates, heaps, parts, tiles."""

import numpy as np
import pytest

from cotton3dg.masks.non_max_suppression import Candidate, crop, cut_by_tile, paint_candidates, resolve_overlaps, tiles


def box(top: int, left: int, bottom: int, right: int, score: float) -> Candidate:
    return Candidate(top, left, np.ones((bottom - top, right - left), bool), score)


def test_a_mask_is_cropped_to_what_it_holds() -> None:
    mask = np.zeros((20, 30), bool)
    mask[5:8, 10:14] = True
    candidate = crop(mask, 100, 200, 1.5)
    assert (candidate.top, candidate.left, candidate.score) == (105, 210, 1.0)
    assert candidate.mask.shape == (3, 4) and candidate.mask.all()
    assert crop(np.zeros((4, 4), bool), 0, 0, 0.5) is None
    assert crop(np.zeros((0, 0), bool), 0, 0, 0.5) is None


def test_the_surest_of_duplicates_stays() -> None:
    first, second, other = box(0, 0, 10, 10, 0.6), box(1, 1, 11, 11, 0.9), box(0, 30, 10, 40, 0.3)
    assert resolve_overlaps([first, second, other]) == [second, other]


def test_a_part_of_an_object_goes_and_a_heap_of_objects_goes() -> None:
    whole, part = box(0, 0, 20, 20, 0.5), box(2, 2, 8, 8, 0.9)
    assert resolve_overlaps([whole, part]) == [whole]
    heap, left, right = box(0, 0, 20, 42, 0.9), box(0, 0, 20, 20, 0.5), box(0, 22, 20, 42, 0.4)
    assert resolve_overlaps([heap, left, right]) == [left, right]


def test_a_large_object_with_two_small_specks_in_it_is_no_heap() -> None:
    whole = box(0, 0, 30, 30, 0.5)
    assert resolve_overlaps([whole, box(2, 2, 8, 8, 0.9), box(20, 20, 26, 26, 0.9)]) == [whole]


def test_parts_of_an_object_in_a_heap_go_with_neither() -> None:
    heap, left, right = box(0, 0, 20, 42, 0.9), box(0, 0, 20, 20, 0.5), box(0, 22, 20, 42, 0.4)
    part = box(5, 5, 10, 10, 0.8)
    assert resolve_overlaps([heap, left, right, part]) == [left, right]


def test_contested_pixels_belong_to_the_surest() -> None:
    ids, scores = paint_candidates([box(0, 0, 6, 6, 0.4), box(4, 4, 10, 10, 0.8)], 12, 12)
    assert ids[5, 5] == ids[9, 9] == 1 and ids[0, 0] == 2 and ids[11, 11] == 0
    assert scores == {1: 0.8, 2: 0.4} and ids.dtype == np.uint16
    ids, scores = paint_candidates([box(2, 2, 4, 4, 0.4), box(0, 0, 9, 9, 0.8)], 12, 12)
    assert scores == {1: 0.8}  # nothing of the other is left to see


@pytest.mark.parametrize("shape", [(100, 100), (720, 1280), (33, 401), (65, 64)])
def test_tiles_cover_the_image_and_overlap(shape: tuple[int, int]) -> None:
    squares = tiles(*shape, 64)
    covered = np.zeros(shape, int)
    for top, left, bottom, right in squares:
        assert 0 <= top < bottom <= shape[0] and 0 <= left < right <= shape[1]
        assert bottom - top == min(64, shape[0]) and right - left == min(64, shape[1])
        covered[top:bottom, left:right] += 1
    assert covered.min() == 1
    # Whatever is up to a quarter of a tile wide is whole in one of them.
    for x in range(0, shape[1] - 16):
        assert any(left <= x and x + 16 <= right for _, left, _, right in squares)
    assert tiles(*shape, 0) == [(0, 0, *shape)]


def test_only_borders_within_the_image_cut() -> None:
    tile = (0, 50, 64, 114)
    assert cut_by_tile(np.array([50.5, 10, 70, 20]), tile, 64, 200)
    assert cut_by_tile(np.array([90, 10, 113.5, 20]), tile, 64, 200)
    assert not cut_by_tile(np.array([60, 0, 70, 64]), tile, 64, 200)
    assert not cut_by_tile(np.array([60, 10, 114, 20]), tile, 64, 114)
