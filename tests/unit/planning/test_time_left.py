# SPDX-License-Identifier: Apache-2.0
"""The time left of a run: as expected at its beginning, by what is seen towards its end, and never below 0."""

import math

import pytest

from cotton3dg.pipeline import STAGES, Step, stage_options
from cotton3dg.planning.time_left import PRIOR_S, TimeLeft, time_left_of
from cotton3dg.stage import Footage

EXPECTED = {"frames": 10.0, "train": 60.0, "traits": 10.0, "report": 5.0}


def begun(name: str, now_s: float = 0.0, expected=EXPECTED) -> TimeLeft:
    left = TimeLeft(expected, uncounted=("report",))
    left.begin(name, now_s)
    return left


def test_the_costs_are_counted_down_until_a_step_says_more() -> None:
    left = begun("frames")
    assert left.seconds(0.0) == 85.0
    assert left.seconds(4.0) == 81.0
    assert left.seconds(40.0) == 75.0  # later than expected: what is ahead is still ahead
    assert left.place == "1 of 3"


def test_a_slow_machine_is_slow_in_what_is_ahead() -> None:
    left = begun("frames")
    left.advance(1, 100, 1.0)
    left.end(20.0)
    left.begin("train", 20.0)
    assert left.seconds(20.0) == (PRIOR_S + 20) / (PRIOR_S + 10) * (60 + 10 + 5)
    assert left.place == "2 of 3"


def test_what_is_seen_weighs_more_the_more_of_it_there_is() -> None:
    """Training takes 120 s instead of 60."""
    left = begun("train", expected={"train": 60.0})
    left.advance(0, 100, 0.0)
    told_too_little = []
    for done in (1, 10, 50, 90):
        now_s = 1.2 * done
        left.advance(done, 100, now_s)
        true_s = 120 - now_s
        assert true_s / 2 < left.seconds(now_s) < true_s
        told_too_little.append(1 - left.seconds(now_s) / true_s)
    assert told_too_little == sorted(told_too_little, reverse=True)
    assert told_too_little[0] > 0.4 and told_too_little[-1] < 0.02


def test_what_is_ahead_does_not_leap_when_a_slow_step_ends() -> None:
    left = begun("frames")
    left.advance(0, 100, 0.0)
    left.advance(99, 100, 40.0)
    before_s = left.seconds(40.0)
    left.end(40.4)
    left.begin("train", 40.4)
    assert left.seconds(40.4) == pytest.approx(before_s, rel=0.02)


def test_at_its_end_a_step_has_no_time_left_and_nothing_is_negative() -> None:
    left = begun("train", expected={"train": 60.0})
    for done, now_s in ((0, 0.0), (50, 500.0), (100, 600.0), (120, 700.0)):
        left.advance(done, 100, now_s)
        assert left.seconds(now_s) >= 0
    assert left.seconds(700.0) == 0


def test_a_step_that_goes_on_is_judged_by_the_rest() -> None:
    left = begun("train", expected={"train": 100.0})
    left.advance(60, 100, 2.0)
    assert left.seconds(2.0) == pytest.approx(40.0)
    left.advance(80, 100, 22.0)
    assert left.seconds(22.0) == pytest.approx(20.0)
    left.end(42.0)
    left.begin("more", 42.0)
    assert math.isnan(left.seconds(42.0))  # nothing is expected of it


def test_without_expectations_only_the_step_at_work_counts() -> None:
    left = begun("simulate", expected=None)
    assert math.isnan(left.seconds(3.0)) and left.place == ""
    left.advance(0, 0, 3.0)
    assert math.isnan(left.seconds(3.0))
    left.advance(1, 4, 4.0)
    left.advance(2, 4, 8.0)
    assert left.seconds(8.0) > 0


def test_one_step_alone_has_no_place() -> None:
    assert begun("train", expected={"train": 60.0, "report": 5.0}).place == ""


def test_a_run_expects_the_stages_that_are_due_and_the_page(monkeypatch) -> None:
    monkeypatch.setattr("cotton3dg.planning.cost.examine_footage", lambda workspace: Footage(900, 1920, 1080))
    options = stage_options(None)
    steps = [Step(stage, options[stage], "" if stage in ("frames", "sfm") else "stale") for stage in STAGES]
    left = time_left_of(None, options, steps)  # type: ignore[arg-type]
    assert list(left.expected_s) == [*STAGES[2:], "report"]
    assert len(left.numbers) == 6 and left.expected_s["train"] > left.expected_s["scale"] > 0
