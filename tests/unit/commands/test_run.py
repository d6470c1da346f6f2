# SPDX-License-Identifier: Apache-2.0
"""What a run ends with: the four traits in the report's words, and the same for programs."""

import json
import shutil
from dataclasses import replace

import pytest
from scenes.finished_scene import finished_workspace

from cotton3dg.cli.display import print_ending
from cotton3dg.commands.run import MEASURE, Ending, read_ending
from cotton3dg.io.tables import TRAITS
from cotton3dg.report.advice import FLAGS
from cotton3dg.report.facts import read_facts
from cotton3dg.report.page import trait_cards
from cotton3dg.report.verdicts import SURENESS
from cotton3dg.schemas.scale import ScaleInfo
from cotton3dg.workspace import Workspace


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Workspace:
    return finished_workspace(tmp_path_factory.mktemp("run") / "plant_017")


@pytest.fixture(scope="module")
def ending(finished) -> Ending:
    return read_ending(finished)


def told(ending: Ending, capsys, **how: bool) -> list[str]:
    print_ending(ending, **how)
    return capsys.readouterr().out.splitlines()


def test_it_is_what_the_report_shows(finished, ending) -> None:
    assert ending.cards == trait_cards(read_facts(finished))
    assert ending.flags == {flag: FLAGS[flag].title for flag in ("few_frames_registered", "orbit_gap")}
    assert ending.report is None


def test_four_lines_have_value_interval_and_sureness(ending, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    heading, *traits = told(ending, capsys)[:5]
    assert heading.split() == ["plant_017", "95", "%", "interval"]
    for line, card in zip(traits, ending.cards, strict=True):
        assert line.startswith(f"● {card['name']}") and card["value"] in line
        assert " to " in line and line.rstrip().endswith(SURENESS[card["sure"]])


def test_four_lines_stay_four_in_forty_columns(ending, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    for line, card in zip(told(ending, capsys)[1:5], ending.cards, strict=True):
        assert line.startswith(f"● {card['name']}") and card["range"] in line and len(line) <= 40


def test_the_rest_is_flags_in_plain_words_and_where_all_is(ending, capsys) -> None:
    rest = told(replace(ending, report=ending.traits_csv.with_name("report.html")), capsys)[5:]
    assert rest[:2] == [f"! {title}" for title in ending.flags.values()]
    assert rest[2].startswith("report: ") and rest[3].startswith(f"saved as {ending.traits_csv}; --all ")
    assert len(rest) == 4


def test_all_prints_every_column(ending, capsys) -> None:
    names = [line.split()[0] for line in told(ending, capsys, everything=True)]
    assert names[: len(TRAITS)] == [column.name for column in TRAITS]


def test_programs_get_numbers_and_null(ending, capsys) -> None:
    found = json.loads("\n".join(told(ending, capsys, as_json=True)))
    assert found["traits"]["boll_count"] == 4 and found["traits"]["seed_cotton_g"] is None
    assert found["traits"].keys() == {column.name for column in TRAITS}
    assert found["sureness"]["plant_height_cm"] == ending.cards[2]["sure"]
    assert found["flags"] == ending.flags and found["report"] is None


def test_a_row_on_results_that_are_out_of_date_is_not_shown(finished, tmp_path, capsys) -> None:
    plant = Workspace(shutil.copytree(finished.root, tmp_path / "plant_017"))
    plant.record_file("train").unlink()
    problem, *rest = told(read_ending(plant), capsys)
    assert problem.startswith("the stage train has not run yet; run `cotton3dg run`")
    assert not any(line.startswith("●") for line in rest)


def test_an_unsure_trait_has_another_mark_and_its_half_width(ending, capsys) -> None:
    """Where there is no colour, the mark's shape says it."""
    words = "less sure than usual: ± 14 %"
    unsure = {**ending.cards[1], "sure": "yellow", "sureness": words}
    line = told(replace(ending, cards=[unsure]), capsys)[1]
    assert line.startswith("■ Boll volume") and line.endswith(words)


def test_a_blank_trait_says_why(ending, capsys) -> None:
    blank = dict.fromkeys(ending.cards[2], "") | {"name": "Plant height", "value": "–", "note": "no scale"}
    line = told(replace(ending, cards=[blank]), capsys)[1]
    assert line.split() == ["Plant", "height", "–", "no", "scale"]


@pytest.mark.parametrize(
    ("assumed", "words"),
    [(True, f"table taken as 120 x 60 cm; {MEASURE}"), (False, "table of 120 x 60 cm")],
)
def test_the_table_is_said_once(finished, monkeypatch, assumed, words) -> None:
    facts = read_facts(finished)
    scale = replace(ScaleInfo.load(finished.scale_json), table_cm=(120.0, 60.0), table_assumed=assumed)
    stages = tuple(
        replace(item, record=replace(item.record, flags=("table_size_assumed",) if assumed else ()))
        for item in facts.stages
        if item.stage == "scale"
    )
    changed = replace(facts, scale=scale, stages=stages)
    monkeypatch.setattr("cotton3dg.commands.run.read_facts", lambda workspace: changed)
    found = read_ending(finished)
    assert found.table == words and found.flags == {}
