# SPDX-License-Identifier: Apache-2.0
"""Work on plants that a page asks for."""

import time

import pytest

from cotton3dg.errors import BadUsage
from cotton3dg.io.command_queue import STOPPED, WAITS, CommandQueue, how_far


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("train (3 of 8): 700/1500 loss 0.03, about 40 s left", "train, 46 %, about 40 s left"),
        ("sfm (2 of 8): 5/60", "sfm, 8 %"),
        ("check: 12/12, about 1 s left", "check, 99 %, about 1 s left"),
        ("train: starts", ""),
        ("options: preset draft (command line)", ""),
        ("masks (5 of 8): 0/0", ""),
    ],
)
def test_a_line_says_how_far_the_work_is(line, text):
    assert how_far(line) == text


def until_idle(queue):
    for _ in range(1200):
        if not queue.asked:
            return
        time.sleep(0.1)
    raise AssertionError(queue.asked)


def test_work_that_fails_says_why_and_what_is_stopped_says_so(tmp_path):
    queue = CommandQueue()
    try:
        queue.add("first", ["run", str(tmp_path / "nowhere")])
        queue.add("second", ["run", str(tmp_path / "nowhere else")])
        with pytest.raises(BadUsage, match="waits already"):
            queue.add("second", ["run", str(tmp_path)])
        assert queue.text("second") == WAITS
        queue.stop("second")
        assert queue.text("second") in ("stops", STOPPED["run"])
        queue.stop("third")
        until_idle(queue)
        assert "does not exist" in queue.text("first") and queue.text("second") == STOPPED["run"]
        queue.add("second", ["run", str(tmp_path / "nowhere else")])
        until_idle(queue)
        assert "does not exist" in queue.text("second")
    finally:
        queue.close()
