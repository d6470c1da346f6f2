# SPDX-License-Identifier: Apache-2.0
"""Boxes in photos beside true ones: made-up boxes whose overlaps are counted by hand."""

import math

import numpy as np
import pytest
from lint_by_colour import lint_score
from photo_boxes import compare, enclose, find_lint_colour, match_boxes, read_boxes, score, tabulate
from scenes.lint_scene import orbit_cameras, photo


def boxes(*corners: tuple[float, float, float, float]) -> np.ndarray:
    """(N, 4) left, top, right, bottom, px."""
    return np.array(corners, np.float64).reshape(-1, 4)


def scores(found: np.ndarray, true: np.ndarray, iou: float = 0.5, wider_than: float = 0) -> tuple[float, ...]:
    """Precision, recall and F1."""
    return tuple(score(compare(found, true), iou, wider_than, math.inf).values())


def test_the_same_boxes_in_another_order_are_perfect():
    true = boxes((0, 0, 10, 10), (20, 20, 50, 60))
    assert scores(true[::-1], true) == (1, 1, 1)


def test_the_largest_overlap_is_matched_first_and_one_to_one():
    true = boxes((0, 0, 10, 10))
    found = boxes((0, 0, 10, 6), (0, 0, 10, 8), (30, 30, 40, 40))
    assert match_boxes(found, true) == [(pytest.approx(0.8), 1, 0)]
    assert scores(found, true) == (pytest.approx(1 / 3), 1, 0.5)


def test_a_pair_below_the_threshold_is_a_miss_and_a_false_alarm():
    found, true = boxes((0, 0, 10, 10)), boxes((0, 0, 10, 25))
    assert scores(found, true, iou=0.39) == (1, 1, 1)
    assert scores(found, true, iou=0.41) == (0, 0, 0)


def test_narrow_true_boxes_are_neither_missed_nor_false():
    true = boxes((0, 0, 100, 100), (200, 0, 270, 70), (300, 0, 330, 30))
    found = boxes((0, 0, 100, 100), (200, 0, 285, 70))  # the second is wider than 80, what it hits is not
    assert scores(found, true, wider_than=80) == (1, 1, 1)


def test_narrow_found_boxes_count_only_where_they_hit_wide_ones():
    true = boxes((0, 0, 100, 100), (200, 0, 300, 100))
    found = boxes((0, 0, 70, 100), (400, 0, 450, 50), (200, 0, 230, 30))
    assert scores(found, true, wider_than=80)[:2] == (1, 0.5)
    wide = np.concatenate([found, boxes((500, 0, 590, 90))])
    assert scores(wide, true, wider_than=80)[:2] == (0.5, 0.5)


def test_nothing_at_all_is_no_score():
    assert np.isnan(scores(boxes(), boxes())).all()
    assert scores(boxes(), boxes((0, 0, 9, 9)))[1:] == (0, 0)


def test_every_box_is_in_one_range_of_widths():
    true = boxes((0, 0, 40, 9), (50, 0, 130, 9), (200, 0, 281, 9))
    table = tabulate({"a": [compare(true, true)]}, 50.0)
    assert dict(zip(table["width, px"], table["boxes"], strict=True)) == {
        "all": 3, "<40": 1, "40-80": 1, ">80": 1, ">50": 2,
    }  # fmt: skip
    assert (table["F1 at 0.5"] == 1).all()


def test_labels_are_boxes_or_outlines(tmp_path):
    (tmp_path / "a.txt").write_text("0 0.5 0.5 0.2 0.4\n\n1 0.1 0.1 0.3 0.2 0.2 0.6\n0 0 0.5 0.2 1\n")
    expected = [(80, 30, 120, 70), (20, 10, 60, 60), (0, 0, 20, 100)]
    assert read_boxes(tmp_path / "a.txt", height=100, width=200) == pytest.approx(boxes(*expected))
    assert read_boxes(tmp_path / "none.txt", height=100, width=200).shape == (0, 4)


def test_boxes_enclose_whole_pixels():
    ids = np.zeros((20, 30), np.uint16)
    ids[2:5, 7:9] = ids[10, 12] = 3
    ids[19, 29] = 7
    assert enclose(ids).tolist() == [[7, 2, 13, 11], [29, 19, 30, 20]]


@pytest.mark.parametrize("exposure", [0.3, 0.6, 1.0])
def test_lint_scores_high_at_any_exposure_and_wood_does_not(exposure: float):
    image, ids = photo(orbit_cameras(16)[2], exposure=exposure)
    score = lint_score(image)
    assert score.shape == ids.shape and score.min() >= 0 and score.max() <= 1
    assert score[ids > 0].mean() > 0.8
    assert score[220:, 200:280][ids[220:, 200:280] == 0].mean() < 0.1  # the table


def test_pieces_of_lint_colour_are_instances():
    image = np.full((60, 80, 3), (60, 90, 40), np.uint8)
    image[5:25, 10:30] = image[40:50, 50:70] = 240
    image[30, 40:42] = 240  # too small
    assert enclose(find_lint_colour(image)).tolist() == [[10, 5, 30, 25], [50, 40, 70, 50]]
