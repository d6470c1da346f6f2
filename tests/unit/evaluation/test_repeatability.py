# SPDX-License-Identifier: Apache-2.0
"""Films of unchanged plants: which bolls all found, scatter and bias by hand, of a plant and of fields."""

import math
import re

import numpy as np
import pytest
from scenes.filmed_scene import filmed_again, grown, leaning, save_film
from scipy.stats import ttest_rel
from typer.testing import CliRunner

from cotton3dg.cli.app import app
from cotton3dg.errors import BadInput, BadUsage
from cotton3dg.evaluation.repeatability import find_bias, repeat, repeats_text
from cotton3dg.evaluation.repeatability_page import write_repeats
from cotton3dg.io.tables import read_rows

VOLUMES = np.array([40.0, 45, 50, 55, 60, 65])


@pytest.fixture
def three_films(tmp_path):
    """Six bolls; the second film lacks boll 3 and sees all 2 cm3 larger, the third finds one more."""
    plant = grown(6, seed=9)
    second = filmed_again(plant, leaning(30), kept=[0, 1, 3, 4, 5])
    third = filmed_again(plant, leaning(-80))
    false = leaning(-80) @ np.array([9.0, -9.0, 60.0])
    third = type(plant)(np.vstack([third.centres_cm, false]), (*third.branch_of, 0), third.plant_map)
    films = [tmp_path / name / "p1" for name in ("one", "two", "three")]
    heights = [{"plant_height_cm": height, "plant_height_error_cm": 0.4} for height in (70.0, 70.3, 70.6)]
    save_film(films[0], plant, VOLUMES, traits=heights[0])
    save_film(films[1], second, VOLUMES[[0, 1, 3, 4, 5]] + 2, traits=heights[1])
    save_film(films[2], third, np.append(VOLUMES, 20.0), traits=heights[2])
    return films


def test_bolls_of_all_films_are_matched(three_films):
    found = repeat(three_films)
    rows = {row.boll: row for row in found.bolls}
    assert [rows[n].n_films for n in range(1, 8)] == [3, 3, 2, 3, 3, 3, 1]
    assert rows[3].boll_ids == ("3", "-", "3")
    assert rows[4].boll_ids == ("4", "3", "4")
    assert rows[7].boll_ids == ("-", "-", "7")
    # 40, 42, 40 cm3.
    assert rows[1].volume_mean_cm3 == pytest.approx(122 / 3)
    assert rows[1].volume_sd_cm3 == pytest.approx(math.sqrt(4 / 3))
    assert rows[1].volume_cv_pct == pytest.approx(100 * math.sqrt(4 / 3) / (122 / 3))
    assert rows[1].place_sd_cm < 0.2
    assert math.isnan(rows[7].volume_sd_cm3)


def test_scatter_of_traits_and_of_single_bolls(three_films):
    rows = {row.trait: row for row in repeat(three_films).traits}
    height = rows["plant_height_cm"]
    assert (height.n, height.mean, height.sd) == (1, pytest.approx(70.3), pytest.approx(0.3))
    assert height.cv_pct == pytest.approx(30 / 70.3)
    assert height.error == pytest.approx(0.4)
    # Five bolls in all films, each v, v + 2, v.
    assert (rows["boll volume"].n, rows["boll volume"].sd) == (5, pytest.approx(math.sqrt(4 / 3)))


def test_bias_is_a_paired_t_test(three_films):
    bias = {(row.film, row.trait): row for row in repeat(three_films).bias}
    assert bias[str(three_films[1]), "boll volume"].bias == pytest.approx(2.0)
    assert bias[str(three_films[2]), "boll volume"].bias == pytest.approx(0.0)
    assert bias[str(three_films[2]), "boll volume"].n == 6
    rng = np.random.default_rng(0)
    first = rng.uniform(30, 80, 12)
    other = first + rng.normal(1, 2, 12)
    row = find_bias("b", "boll volume", "cm3", first, other)
    expected = ttest_rel(other, first)
    assert (row.t, row.p) == (pytest.approx(expected.statistic), pytest.approx(expected.pvalue))
    interval = expected.confidence_interval()
    assert (row.low, row.high) == (pytest.approx(interval.low), pytest.approx(interval.high))
    sd = np.std(other - first, ddof=1)
    assert row.agreement_high == pytest.approx(row.bias + 1.96 * sd)
    assert math.isnan(find_bias("b", "x", "cm", first, first).p)


def test_fields_are_paired_by_plant(tmp_path):
    rng = np.random.default_rng(1)
    for plant in range(4):
        layout = grown(6, seed=20 + plant)
        for number, name in enumerate(("monday", "tuesday")):
            seen = filmed_again(layout, leaning(rng.uniform(-180, 180)), noise_cm=0.1, seed=plant)
            height = {"plant_height_cm": 60.0 + 5 * plant + number, "plant_height_error_cm": 0.5}
            save_film(tmp_path / name / f"p{plant}", seen, VOLUMES, traits=height)
    save_film(tmp_path / "monday" / "alone", grown(6, seed=1), VOLUMES)
    found = repeat([tmp_path / "monday", tmp_path / "tuesday"])
    assert len(found.plants) == 4
    height = next(row for row in found.traits if row.trait == "plant_height_cm")
    assert (height.n, height.sd) == (4, pytest.approx(math.sqrt(0.5)))
    # All four plants are 1 cm higher: a bias without scatter, of which t is not defined.
    bias = next(row for row in found.bias if row.trait == "plant_height_cm")
    assert (bias.n, bias.bias) == (4, pytest.approx(1.0))
    assert next(row for row in found.traits if row.trait == "boll volume").n == 24


def test_a_plant_of_a_field_that_is_another_one_is_left_out(tmp_path):
    for name, seeds in (("monday", (3, 5)), ("tuesday", (3, 60))):
        for number, seed in enumerate(seeds):
            save_film(tmp_path / name / f"p{number}", grown(9, seed=seed), np.full(9, 50.0))
    found = repeat([tmp_path / "monday", tmp_path / "tuesday"])
    assert len(found.plants) == 1
    assert found.refused[0].startswith("p1: ")
    assert "left out: p1" in repeats_text(found)


def test_command(three_films, tmp_path):
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["repeat", *map(str, three_films), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "5 of 7 bolls found in all films" in result.output
    assert len(read_rows(out / "repeat_bolls.csv")) == 7
    assert {row["trait"] for row in read_rows(out / "repeat_traits.csv")} >= {"boll volume", "plant_height_cm"}
    assert len(read_rows(out / "repeat_bias.csv")) == 4
    assert (out / "repeat.png").stat().st_size > 10000
    page = (out / "repeat.html").read_text("utf-8")
    assert "5 of 7 bolls were found in all films" in page
    rows = [re.findall(r"<span>(.*?)</span>", row) for row in page.split('<th scope="row"')[1:]]
    assert rows[0] == ["1: 40.0", "1: 42.0", "1: 40.0"]
    assert rows[2] == ["3: 50.0", "–", "3: 50.0"]
    assert rows[6] == ["–", "–", "7: 20.0"]


def test_page_of_a_field(tmp_path):
    for name in ("monday", "tuesday"):
        for plant in range(2):
            save_film(tmp_path / name / f"p{plant}", grown(6, seed=20 + plant), VOLUMES)
    write_repeats(tmp_path / "out", repeat([tmp_path / "monday", tmp_path / "tuesday"]))
    page = (tmp_path / "out" / "repeat.html").read_text("utf-8")
    assert f"<li>{tmp_path / 'tuesday'}</li>" in page
    assert page.count('<th scope="row"') == 12
    assert page.count("<td>p1</td>") == 6


def test_what_cannot_be_repeated(three_films, tmp_path):
    with pytest.raises(BadUsage):
        repeat(three_films[:1])
    with pytest.raises(BadUsage, match="some of the folders"):
        repeat([three_films[0], three_films[1].parent])
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadInput, match="no plant is finished"):
        repeat([tmp_path / "empty", three_films[0].parent])
