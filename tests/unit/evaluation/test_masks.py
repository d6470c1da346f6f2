# SPDX-License-Identifier: Apache-2.0
"""Masks beside true ones, on squares whose overlaps are counted by hand."""

import math

import numpy as np
import pytest

from cotton3dg.evaluation.mask_table import add_to_table
from cotton3dg.evaluation.masks import MaskCounts, count_masks, match_ious, score_masks
from cotton3dg.io.tables import read_rows


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


def test_both_means_of_the_overlap() -> None:
    """By hand: of three true masks one is met by 2/3, one by 1/3 and one by nothing."""
    true = squares((0, 0, 10), (20, 20, 10), (40, 0, 10))
    found = squares((0, 2, 10), (20, 25, 10))  # 80 / 120 and 50 / 150
    counts = count_masks(found, true)
    assert (counts.n_true, counts.n_found, counts.hits) == (3, 2, (2, 1, 0))
    assert counts.miou_hits == pytest.approx(2 / 3)
    assert counts.miou_all == pytest.approx((2 / 3 + 1 / 3 + 0) / 3)


def test_small_masks_count_the_same_on_either_side() -> None:
    """A mask of 25 px over one of 100 px is judged, two of 25 px are not; nor would they the other way round."""
    small = squares((0, 0, 5), (30, 30, 5), (50, 0, 5))
    large = squares((0, 0, 10), (30, 30, 5), (20, 0, 10))
    there, back = count_masks(small, large), count_masks(large, small)
    assert (there.n_true, there.n_found, there.hits) == (2, 1, (1, 0, 0))
    assert (back.n_true, back.n_found, back.hits) == (1, 2, (1, 0, 0))


def test_the_table_holds_images_plants_and_all_of_a_back_end(tmp_path) -> None:
    good, bad = MaskCounts(4, 4, (4, 4, 2), 3.2, 3.2), MaskCounts(4, 2, (1, 0, 0), 0.0, 0.4)
    table = tmp_path / "scores" / "masks.csv"
    add_to_table(table, "a", "bolls", {"0.jpg": bad})
    add_to_table(table, "a", "bolls", {"0.jpg": good, "1.jpg": bad})  # in place of what was there
    add_to_table(table, "a", "yolo", {"0.jpg": bad})
    add_to_table(table, "=b", "bolls", {"0.jpg": bad})
    rows = {(row["plant_id"], row["backend"], row["image"]): row for row in read_rows(table)}
    assert len(rows) == len(read_rows(table)) == 9
    assert rows["a", "bolls", "all"]["recall_50"] == "0.5000"
    pooled = rows["all", "bolls", "all"]
    assert (pooled["n_true"], pooled["n_found"], pooled["hits_50"]) == ("12", "8", "4")
    assert pooled["precision_50"] == "0.5000" and pooled["miou_hits"] == "0.8000"
    assert float(pooled["miou_all"]) == pytest.approx((3.2 + 0.4 + 0.4) / 12, abs=1e-4)
    assert rows["all", "yolo", "all"]["miou_hits"] == ""


def test_missed_specks_do_not_count() -> None:
    scores, _ = score_masks([(squares((0, 0, 10)), squares((0, 0, 10), (30, 30, 5)))])
    assert scores[1].recall == 1


def test_nothing_at_all_is_no_score() -> None:
    empty = np.zeros((60, 60), np.uint16)
    scores, mean_iou = score_masks([(empty, empty)])
    assert math.isnan(scores[0].f1) and math.isnan(mean_iou)
