# SPDX-License-Identifier: Apache-2.0
"""The front of settings worth choosing, and durations."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cotton3dg.errors import BadUsage
from cotton3dg.planning.tradeoff import format_duration, pareto_front, parse_duration, typical_ratio

VALUES = st.integers(0, 6).map(float)


def test_the_front_leaves_out_what_another_beats():
    seconds, losses = [10.0, 20.0, 30.0, 15.0, 5.0], [5.0, 3.0, 3.0, 6.0, 9.0]
    assert pareto_front(seconds, losses) == [4, 0, 1]


def test_of_equal_settings_the_first_stays():
    assert pareto_front([1.0, 1.0], [2.0, 2.0]) == [0]


def test_what_is_unknown_is_never_on_the_front():
    assert pareto_front([1.0, 2.0, math.inf], [math.nan, 3.0, 0.0]) == [1]
    assert pareto_front([], []) == []


@given(st.lists(st.tuples(VALUES, VALUES), max_size=20))
def test_the_front_is_what_nothing_dominates(points):
    seconds, losses = [p[0] for p in points], [p[1] for p in points]
    front = pareto_front(seconds, losses)

    def dominated(point):
        return any(o[0] <= point[0] and o[1] <= point[1] and o != point for o in points)

    assert {points[i] for i in front} == {point for point in points if not dominated(point)}
    assert [seconds[i] for i in front] == sorted(seconds[i] for i in front)
    assert len({points[i] for i in front}) == len(front)


def test_the_ratio_is_the_median_of_what_was_measured():
    assert typical_ratio([]) == 1.0
    assert typical_ratio([(2.0, 1.0), (9.0, 3.0), (1.0, 1.0)]) == 2.0
    assert typical_ratio([(0.0, 1.0), (1.0, 0.0)]) == 1.0


@pytest.mark.parametrize("text, seconds", [("90s", 90), ("5m", 300), ("1h30m", 5400), ("2.5m", 150), ("1m30s", 90)])
def test_durations_are_read(text, seconds):
    assert parse_duration(text) == seconds


def test_a_time_without_a_unit_is_no_number_of_seconds():
    with pytest.raises(BadUsage, match="'10' has no unit; write 10s for seconds, 10m for minutes"):
        parse_duration("10")


@pytest.mark.parametrize("text", ["", "five", "5 m", "-5m", "0", "0s", "5d", "1m30", "m", "1e3s", "nan"])
def test_what_is_no_duration_is_told(text):
    with pytest.raises(BadUsage, match="time budget"):
        parse_duration(text)


def test_durations_are_said():
    assert [format_duration(s) for s in (7.4, 99, 150, 5399, 9000)] == ["7 s", "99 s", "2.5 min", "90.0 min", "2.5 h"]
