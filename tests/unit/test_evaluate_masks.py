"""Masks beside true ones, on squares whose overlaps are counted by hand."""

import math

import numpy as np
import pytest

from cotton3dg.evaluation.masks import match_ious, score_masks


def squares(*places: tuple[int, int, int]) -> np.ndarray:
    """(60, 60) ids 1, 2, ... of squares at (line, column) of a side."""
    ids = np.zeros((60, 60), np.uint16)
    for number, (line, column, side) in enumerate(places, start=1):
        ids[line : line + side, column : column + side] = number
    return ids


def test_the_same_masks_under_other_ids_are_perfect() -> None:
    true = squares((0, 0, 10), (20, 20, 12))
    found = np.where(true > 0, 9 - true, 0).astype(np.uint16)
    scores, mean_iou = score_masks([(found, true)])
    assert all(score.precision == score.recall == score.f1 == 1 for score in scores)
    assert mean_iou == 1


def test_a_missed_a_false_and_a_shifted_mask() -> None:
    true = squares((0, 0, 10), (20, 20, 10))
    found = squares((0, 2, 10), (40, 40, 10))  # IoU 80 / 120, and one out of nothing
    scores, mean_iou = score_masks([(found, true)])
    assert [score.f1 for score in scores] == [0.5, 0.5, 0]
    assert scores[0].precision == scores[0].recall == 0.5
    assert mean_iou == pytest.approx(2 / 3)


def test_a_mask_over_two_bolls_is_one_hit() -> None:
    true, found = squares((0, 0, 10), (0, 10, 10)), np.zeros((60, 60), np.uint16)
    found[:10, :20] = 1
    ious, _, _ = match_ious(found, true)
    assert sorted(ious.tolist()) == [0, 0.5]


def test_missed_specks_do_not_count() -> None:
    scores, _ = score_masks([(squares((0, 0, 10)), squares((0, 0, 10), (30, 30, 5)))])
    assert scores[1].recall == 1


def test_nothing_at_all_is_no_score() -> None:
    empty = np.zeros((60, 60), np.uint16)
    scores, mean_iou = score_masks([(empty, empty)])
    assert math.isnan(scores[0].f1) and math.isnan(mean_iou)
