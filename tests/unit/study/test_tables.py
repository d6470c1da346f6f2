# SPDX-License-Identifier: Apache-2.0
"""Tables of a study: errors, fronts, Markdown, and a busy machine."""

import math

import pytest

from cotton3dg.study.rows import empty_row
from cotton3dg.study.tables import ERRORS, front, machine_was_busy, markdown, pareto_settings, summary, with_errors


def row(sweep, setting, seconds, psnr_db, count, **more):
    made = empty_row(sweep, setting, "done") | dict.fromkeys(ERRORS, count)
    return made | {
        "full_psnr_db": psnr_db, "seconds": seconds, "idle_seconds": seconds, "cpu_seconds": 2 * seconds,
        "trait_error_pct": abs(count - 10), **more,
    }  # fmt: skip


def test_errors_are_relative_to_the_truth():
    truth = dict.fromkeys(ERRORS, 8.0)
    (told,) = with_errors([row("sh", "0", 1, 20, 10.0)], truth)
    assert told["boll_count_error_pct"] == 25.0 and told["trait_error_pct"] == 25.0 and told["reference"] == "truth"


def test_without_a_truth_the_finest_setting_is_the_reference():
    failed = empty_row("sh", "3", "failed", "x")
    coarse, fine, last = with_errors([row("sh", "0", 1, 20, 9.0), row("sh", "1", 2, 21, 10.0), failed], {})
    assert coarse["trait_error_pct"] == pytest.approx(10.0) and coarse["reference"] == "sh 1"
    assert math.isnan(fine["trait_error_pct"])
    assert math.isnan(last["trait_error_pct"])


def test_a_trait_that_was_not_measured_has_no_error():
    (told,) = with_errors([row("sh", "0", 1, 20, math.nan)], dict.fromkeys(ERRORS, 8.0))
    assert math.isnan(told["trait_error_pct"])


def some_rows():
    base = row("base", "draft", 50.0, 30.0, 10.0)
    return [
        base,
        row("resolution", "120", 20.0, 22.0, 13.0),
        row("resolution", "240", 60.0, 25.0, 12.0),
        {**base, "sweep": "resolution", "setting": "480"},
        row("views", "4", 48.0, 30.0, 14.0),
        row("style", "partial", 10.0, 99.0, 30.0),
        empty_row("images", "300", "skipped", "there are only 120 images"),
    ]


def test_the_fronts_compare_only_what_can_be_compared():
    rows = some_rows()
    # The same model with fewer masks, and other images, are no better renders.
    assert front(rows, "full_psnr_db") == {("base", "draft"), ("resolution", "120")}
    assert front(rows, "trait_error_pct") == {("base", "draft"), ("resolution", "120"), ("style", "partial")}
    assert ("resolution", "480") in pareto_settings(rows)  # the base by another name
    assert ("resolution", "240") not in pareto_settings(rows)


def test_markdown_has_a_table_a_sweep_with_a_column_of_seconds():
    text = markdown(some_rows())
    lines = text.splitlines()
    assert [line for line in lines if line.startswith("**")] == [
        "**Table 1: image resolution**", "**Table 3: number of images**", "**Table 4: capture style**",
        "**Images with masks**",
    ]  # fmt: skip
    head = next(line for line in lines if line.startswith("| longer side"))
    cells = dict(zip(head.split(" | "), next(x for x in lines if x.startswith("| 240")).split(" | "), strict=True))
    assert cells["s"] == "60" and cells["full-size"] == "25.00" and cells["SSIM"] == ""
    assert all(line.count("|") == head.count("|") for line in lines if line.startswith("|"))
    assert "300: skipped, there are only 120 images." in lines


def test_a_busy_machine_is_noticed_and_told():
    rows = some_rows()
    assert not machine_was_busy(rows) and "Other programs" not in markdown(rows)
    slow = [{**item, "seconds": 3 * item["seconds"]} if item["state"] == "done" else item for item in rows]
    assert machine_was_busy(slow) and "Other programs" in markdown(slow)
    assert front(slow, "full_psnr_db") == front(rows, "full_psnr_db")


def test_the_summary_has_a_line_a_setting():
    lines = summary(some_rows()).splitlines()
    assert len(lines) == 8
    assert lines[-1].endswith("skipped: there are only 120 images")
