"""Work on all cores."""

import threading

import cv2

from cotton3dg.core.machine import on_all_cores, usable_cores


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
