# SPDX-License-Identifier: Apache-2.0
"""What changed between two films: bolls gone, new, moved and grown; traits with errors; tables, pictures, a page."""

import math
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scenes.filmed_scene import filmed_again, grown, leaning, save_film
from typer.testing import CliRunner

from cotton3dg.cli.app import app
from cotton3dg.evaluation.change_detection import GONE, NEW, SAME, beyond, compare, comparison_text
from cotton3dg.evaluation.measured_plant import comparable_traits, error_column, find_same_films, read_filmed
from cotton3dg.io.tables import read_rows
from cotton3dg.schemas.record import Record
from cotton3dg.workspace import Workspace


@pytest.fixture
def two_dates(tmp_path):
    """Eight bolls; at the second date 2 and 7 are picked, one is new, boll 4 has grown and boll 5 sagged by 1.5 cm."""
    first = grown(8, seed=4)
    volumes = np.linspace(40, 75, 8)
    save_film(tmp_path / "may" / "p1", first, volumes, traits={"plant_height_cm": 70.0, "plant_height_error_cm": 0.5})
    centres = first.centres_cm.copy()
    centres[4, 2] -= 1.5
    moved = filmed_again(type(first)(centres, first.branch_of, first.plant_map), leaning(65))
    kept = [0, 2, 3, 4, 5, 7]
    newcomer = leaning(65) @ np.array([-9.0, 9.0, 20.0])
    other = type(first)(np.vstack([moved.centres_cm[kept], newcomer]), (1,) * 7, moved.plant_map)
    later = np.append(volumes[kept], 33.0)
    later[2] += 20.0
    # Numbers of another film are others.
    save_film(tmp_path / "june" / "p1", other, later, ids=[7, 6, 5, 4, 3, 2, 1],
              traits={"plant_height_cm": 71.0, "plant_height_error_cm": 0.5})  # fmt: skip
    return tmp_path / "may" / "p1", tmp_path / "june" / "p1"


def test_each_boll_is_told(two_dates):
    (found,) = compare(two_dates)
    assert (found.count(SAME), found.count(GONE), found.count(NEW)) == (6, 2, 1)
    by_first = {boll.boll_first: boll for boll in found.bolls}
    assert {boll.boll_first for boll in found.bolls if boll.state == GONE} == {2, 7}
    assert [by_first[n].boll_other for n in (1, 3, 4, 5, 6, 8)] == [7, 6, 5, 4, 3, 2]
    assert by_first[5].moved_cm == pytest.approx(1.5, abs=0.35)
    assert by_first[1].moved_cm < 0.3
    (newcomer,) = (boll for boll in found.bolls if boll.state == NEW)
    np.testing.assert_allclose(newcomer.place_cm, [-9, 9, 20], atol=0.4)
    assert (newcomer.boll_other, newcomer.boll_first) == (1, None)
    grew = by_first[4]
    # 5 % of 55 and of 75 cm3.
    assert grew.volume_change_cm3 == pytest.approx(20.0, abs=0.02)
    assert grew.volume_change_error_cm3 == pytest.approx(math.hypot(2.75, 3.75), abs=0.02)
    assert grew.beyond_error == "yes"
    assert by_first[1].beyond_error == "no"
    assert math.isnan(by_first[2].volume_change_cm3)
    assert by_first[2].beyond_error == ""


def test_traits_with_their_errors(two_dates):
    (found,) = compare(two_dates)
    rows = {row.trait: row for row in found.traits}
    height = rows["plant_height_cm"]
    assert (height.change, height.error, height.beyond_error) == (1.0, pytest.approx(math.sqrt(0.5)), "no")
    assert height.change_pct == pytest.approx(100 / 70)
    assert rows["boll_count"].change == -1
    assert rows["boll_count"].beyond_error == "yes"  # 1 > 1.96 * hypot(0.3, 0.3)
    assert "canopy_size_cm" not in rows  # blank in both films


def test_a_change_and_its_error():
    assert beyond(2.0, 1.0) == "yes"
    assert beyond(-2.0, 1.0) == "yes"
    assert beyond(1.9, 1.0) == "no"
    assert beyond(math.nan, 1.0) == beyond(1.0, math.nan) == ""


def test_stated_errors_are_found_by_their_names():
    assert error_column("plant_height_cm") == "plant_height_error_cm"
    assert error_column("boll_count") == "boll_count_error"
    assert error_column("boll_volume_cm3") == "boll_volume_error_cm3"
    assert error_column("boll_volume_mean_cm3") == ""
    names = {column.name for column in comparable_traits()}
    assert {"boll_count", "stem_length_cm", "branch_count"} <= names
    assert not {name for name in names if "error" in name or name.startswith("original")}
    assert not {name for name in names if name.endswith(("_low", "_high", "_low_cm", "_high_g"))}
    assert "bolls_lower" in names


def test_command_writes_tables_pictures_and_a_page(two_dates, tmp_path):
    out = tmp_path / "changes"
    result = CliRunner().invoke(app, ["compare", *map(str, two_dates), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "6 the same" in result.output
    rows = read_rows(out / "boll_changes.csv")
    assert [row["state"] for row in rows] == [SAME] * 6 + [GONE] * 2 + [NEW]
    assert rows[0]["film"] == str(two_dates[1])
    assert {row["trait"] for row in read_rows(out / "trait_changes.csv")} >= {"boll_count", "plant_height_cm"}
    assert Image.open(out / "changes_1.png").size[0] > 1000
    page = (out / "comparison.html").read_text()
    assert "p1, comparison – cotton3dg" in page
    assert page.count("<tr>") == 1 + 9 + 1 + len(read_rows(out / "trait_changes.csv"))
    assert "<script" not in page
    assert "http" not in page.replace("http-equiv", "")


def test_another_comparison_is_not_replaced(two_dates, tmp_path):
    out, run = tmp_path / "changes", CliRunner().invoke
    first = ["compare", *map(str, two_dates), "--out", str(out)]
    assert run(app, first).exit_code == 0
    before = {path: path.read_bytes() for path in out.iterdir()}
    refused = run(app, ["compare", *map(str, reversed(two_dates)), "--out", str(out)])
    assert refused.exit_code == 2
    assert "boll_changes.csv is there and was made by `cotton3dg compare" in refused.output
    assert {path: path.read_bytes() for path in out.iterdir()} == before
    assert run(app, first).exit_code == 0


def test_the_same_film_twice_is_noticed(two_dates):
    run = CliRunner().invoke
    for film in two_dates:
        Workspace(film).write_record(Record("frames", inputs={"walk.mp4": "0" * 64}))
    for command in ("compare", "repeat"):
        result = run(app, [command, *map(str, two_dates), "--out", str(two_dates[0].parent / command)])
        assert f"{two_dates[1]} is the same film as {two_dates[0]}" in result.output
    first = read_filmed(two_dates[0])
    assert find_same_films([first, replace(first, film_sha256="1" * 64)]) == []
    assert find_same_films([replace(first, film_sha256="")] * 2) == []


def test_several_films_are_each_compared_with_the_first(two_dates):
    first, second = two_dates
    found = compare([second, first])
    assert [item.first.name for item in found] == [str(second)]
    assert found[0].count(NEW) == 2
    assert "turned by" in comparison_text(found[0])


def test_what_cannot_be_compared(two_dates, tmp_path):
    other = save_film(tmp_path / "p2", grown(8, seed=77), np.full(8, 50.0))
    run = CliRunner().invoke
    result = run(app, ["compare", str(two_dates[0]), str(other), "--out", str(tmp_path / "no")])
    assert result.exit_code == 2
    assert result.output.count("\n") == 1
    assert "cannot be laid on" in result.output
    assert "--turn-deg" in result.output
    assert not (tmp_path / "no").exists()
    unscaled = save_film(tmp_path / "p3", grown(8, seed=4), np.full(8, 50.0), traits={"scale_source": "none"})
    result = run(app, ["compare", str(two_dates[0]), str(unscaled)])
    assert "has no scale" in result.output
    assert run(app, ["compare", str(two_dates[0])]).exit_code == 2
    assert run(app, ["compare", str(two_dates[0]), str(two_dates[0])]).exit_code == 2
    (tmp_path / "empty").mkdir()
    result = run(app, ["compare", str(two_dates[0]), str(tmp_path / "empty")])
    assert "empty: no video" in result.output
