# SPDX-License-Identifier: Apache-2.0
"""Results for programs, and the colours of states that need somebody."""

import json
import math

import pytest
from rich.console import Console

from cotton3dg.batch import Result
from cotton3dg.cli import display
from cotton3dg.commands.correct import Length, Outcome
from cotton3dg.commands.import_ import Row
from cotton3dg.core.runs import State
from cotton3dg.evaluation.masks import MaskCounts
from cotton3dg.evaluation.plant import BollMatches, TraitError
from cotton3dg.pipeline import Step
from cotton3dg.schemas.corrections import Correction, Corrections

FAILED = Result("plant_2", State.FAILED, 4, "no video; film it")
STALE = Result("[plant_3]", State.STALE, None, "scale: option table_length_cm 99.0 -> 100.0")
DONE = Result("plant_1", State.DONE, 0)


@pytest.fixture
def found(capsys):
    """What was printed since, for a program."""
    return lambda: json.loads(capsys.readouterr().out)


def test_an_evaluation_for_programs_has_null_for_what_is_not_known(found) -> None:
    errors = [TraitError("boll_count", 9.0, 10.0), TraitError("plant_height_cm", math.nan, 80.0)]
    display.print_evaluation(errors, BollMatches(10, 9, 8, 0.5, math.nan), as_json=True)
    said = found()
    assert said["traits"][0] == {"trait": "boll_count", "measured": 9.0, "truth": 10.0, "error_pct": -10.0}
    assert said["traits"][1]["measured"] is None and said["traits"][1]["error_pct"] is None
    assert said["bolls"]["n_matched"] == 8 and said["map"] is None


def test_masks_plans_batches_imports_and_corrections_for_programs(found, tmp_path) -> None:
    display.print_mask_scores(MaskCounts(4, 4, (4, 3, 1), 2.4, 2.4), 2, as_json=True)
    assert [score["f1"] for score in found()["scores"]] == [1.0, 0.75, 0.25]
    display.print_plan([Step("train", None, "forced"), Step("scale", None, "")], as_json=True)
    assert [(step["stage"], step["runs"]) for step in found()] == [("train", True), ("scale", False)]
    display.print_batch([FAILED, DONE], tmp_path, as_json=True)
    assert found()[0] == {"folder": "plant_2", "state": "failed", "exit_code": 4, "reason": "no video; film it"}
    display.print_import([Row("walk.mp4", "A1", "copied", folder="A1")], tmp_path, dry_run=False, as_json=True)
    assert found()[0]["folder"] == "A1"
    kept = Corrections((Correction("delete"),))
    display.print_corrections(Outcome(kept, ("boll 3 is gone",), (Length(12.0, 0.1), None), 9, 8), as_json=True)
    said = found()
    assert said["corrections"][0]["kind"] == "delete" and said["refused"] == ["boll 3 is gone"]
    assert said["ruler_lengths"] == [{"length_cm": 12.0, "error_cm": 0.1}, None]
    assert (said["bolls_before"], said["bolls_after"]) == (9, 8)


def test_the_status_of_a_batch_is_a_table_with_every_plant(capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    display.print_batch_status([FAILED, STALE, DONE], as_json=False)
    heading, *rows, count = capsys.readouterr().out.splitlines()
    assert heading.split() == ["plant", "state", "remarks"]
    assert [row.rstrip().split(maxsplit=2) for row in rows] == [
        ["plant_2", "failed", FAILED.reason],
        ["[plant_3]", "stale", STALE.reason],
        ["plant_1", "done"],
    ]
    assert count == "1 of 3 plants done"


def test_failed_is_red_and_stale_yellow_on_a_terminal(capsys, monkeypatch) -> None:
    monkeypatch.setattr(display, "Console", lambda **how: Console(force_terminal=True, color_system="standard", **how))
    display.print_batch_status([FAILED, STALE, DONE], as_json=False)
    said = capsys.readouterr().out
    assert "\x1b[31mfailed" in said and "\x1b[33mstale" in said and "\x1b[39mdone" in said.replace("\x1b[0m", "")
