# SPDX-License-Identifier: Apache-2.0
"""Work on all cores."""

import threading

import cv2
import pytest

from cotton3dg.core.machine import on_all_cores, stream_on_all_cores, usable_cores


def test_results_come_in_the_order_of_the_items():
    """Also where the first take longest: each waits for the one after it."""
    turns = [threading.Event() for _ in range(len(usable_cores()) + 1)]
    turns[-1].set()

    def in_reverse(number):
        assert turns[number + 1].wait(timeout=60)
        turns[number].set()
        return number

    numbers = list(range(len(usable_cores())))
    assert on_all_cores(in_reverse, numbers) == numbers


def test_opencv_has_one_thread_meanwhile_and_its_own_number_after():
    before = cv2.getNumThreads()
    assert on_all_cores(lambda _: cv2.getNumThreads(), range(3)) == [1, 1, 1]
    assert cv2.getNumThreads() == before


def test_items_are_taken_only_as_results_are():
    taken = []

    def items():
        for number in range(20):
            taken.append(number)
            yield number

    results = stream_on_all_cores(lambda number: 2 * number, items())
    assert next(results) == 0
    assert len(taken) <= len(usable_cores()) + 1
    assert list(results) == list(range(2, 40, 2))
    assert list(stream_on_all_cores(str, [])) == []


def test_what_one_item_raises_ends_the_stream():
    results = stream_on_all_cores(lambda number: 1 // number, [2, 1, 0, 1])
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(ZeroDivisionError):
        next(results)
