# SPDX-License-Identifier: Apache-2.0
"""What is said of progress: one line of any width on a terminal, plain lines elsewhere, nothing with --quiet."""

import io

import pytest
from rich.console import Console
from scenes.small_stages import copying_stage, filmed_plant, replace_stages

from cotton3dg import pipeline
from cotton3dg.cli import progress
from cotton3dg.cli.progress import PLAIN_INTERVAL_S, ProgressDisplay, fitting
from cotton3dg.planning import cost
from cotton3dg.planning.time_left import TimeLeft
from cotton3dg.stage import Footage

STAGES = dict.fromkeys(pipeline.STAGES, 10.0)


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def on_terminal(width: int) -> ProgressDisplay:
    display = ProgressDisplay()
    display.console = Console(file=io.StringIO(), force_terminal=True, width=width)
    display.time_left = TimeLeft(STAGES)
    return display


@pytest.mark.parametrize("done_before", [0, 18_200])
def test_the_time_left_does_not_count_what_an_interrupted_run_had_done(clock, capsys, done_before) -> None:
    """Ten steps a second, however many there were at the beginning."""
    show = ProgressDisplay().watched("train")
    for seconds in range(0, 3 * int(PLAIN_INTERVAL_S), 5):
        clock[0] = float(seconds)
        show(done_before + 10 * seconds, 30_000, "loss 0.01")
    starts, *told = capsys.readouterr().err.splitlines()
    assert starts == "train: starts"
    done = done_before + 10 * int(PLAIN_INTERVAL_S)
    left_s = (30_000 - done) / 10
    assert told[0] == f"train: {done}/30000 loss 0.01, about {left_s / 60:.1f} min left"
    assert len(told) == 2


@pytest.mark.parametrize(
    ("width", "line"),
    [
        (80, "3 of 8 train 30 %, about 57 s left, 3 s so far, loss 0.0123, 30000 Gaussians"),
        (60, "3 of 8 train 30 %, about 57 s left, 3 s so far"),
        (40, "3 of 8 train 30 %, about 57 s left"),
        (20, "3 of 8 train 30 %"),
    ],
)
def test_the_line_on_a_terminal_has_what_fits(clock, width, line) -> None:
    display = on_terminal(width)
    show = display.watched("train")
    clock[0] = 3.0
    show(750, 2500, "loss 0.0123, 30000 Gaussians")
    assert display._line().plain == line


def test_before_the_first_message_nothing_is_counted_and_no_stage_is_captioned_with_its_reason(clock) -> None:
    display = on_terminal(80)
    display.started(pipeline.Step("train", None, "no finished result"))
    assert display._line().plain == "3 of 8 train, about 60 s left, 0 s so far"
    display.watched("growing")
    assert display._line().plain == "growing, 0 s so far"


def test_work_that_tidies_up_is_not_done_yet(clock) -> None:
    display = on_terminal(80)
    display.watched("masks")(48, 48)
    assert display._line().plain.startswith("5 of 8 masks 99 %,")


def test_what_matters_most_is_there_in_any_width() -> None:
    assert fitting(("train", "", "about 40 s left"), 10) == "train"
    assert fitting(("train", "about 40 s left", "x"), 22) == "train, about 40 s left"


@pytest.mark.parametrize(
    ("loud", "told", "untold"),
    [
        (None, "frames: done in", "letters 5"),
        (True, "(letters 5)", "nothing"),
        (True, "frames: starts (no finished result)", "nothing"),
        (False, "", "frames"),
    ],
)
def test_verbose_says_figures_and_reasons_and_quiet_nothing(tmp_path, monkeypatch, capsys, loud, told, untold) -> None:
    replace_stages(monkeypatch, copying_stage)
    plant = filmed_plant(tmp_path)
    with ProgressDisplay(loud) as watcher:
        pipeline.run(plant, pipeline.stage_options(plant), watcher=watcher)
    said = capsys.readouterr()
    assert told in said.err and untold not in said.err and said.out == ""


def test_a_run_knows_which_of_its_stages_are_due(tmp_path, monkeypatch) -> None:
    replace_stages(monkeypatch, copying_stage)
    monkeypatch.setattr(cost, "examine_footage", lambda workspace: Footage(900, 1920, 1080))
    plant = filmed_plant(tmp_path)
    options = pipeline.stage_options(plant)
    pipeline.run(plant, options, pipeline.selected(last="scale"))
    watcher = ProgressDisplay()
    watcher.begins(plant, options, pipeline.STAGES, force=False)
    assert list(watcher.time_left.numbers) == ["masks", "segment", "cluster", "traits"]
    watcher.begins(plant, options, pipeline.STAGES, force=True)
    assert len(watcher.time_left.numbers) == 8
