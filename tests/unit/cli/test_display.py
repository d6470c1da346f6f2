"""What is said of progress where there is no terminal."""

import pytest

from cotton3dg.cli import display
from cotton3dg.cli.display import PLAIN_INTERVAL_S, ProgressDisplay


@pytest.mark.parametrize("done_before", [0, 18_200])
def test_the_time_left_does_not_count_what_an_interrupted_run_had_done(monkeypatch, capsys, done_before) -> None:
    """Ten steps a second, however many there were at the beginning."""
    clock = [0.0]
    monkeypatch.setattr(display.time, "monotonic", lambda: clock[0])
    show = ProgressDisplay().watched("train")
    for seconds in range(0, 3 * int(PLAIN_INTERVAL_S), 5):
        clock[0] = float(seconds)
        show(done_before + 10 * seconds, 30_000, "loss 0.01")
    starts, *told = capsys.readouterr().err.splitlines()
    assert starts == "train: starts"
    left_s = (30_000 - done_before - 10 * PLAIN_INTERVAL_S) / 10
    assert told[0] == f"train: {done_before + 300}/30000 loss 0.01, about {left_s:.0f} s left"
    assert len(told) == 2
