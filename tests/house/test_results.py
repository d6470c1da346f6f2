# SPDX-License-Identifier: Apache-2.0
"""docs/results.md and README's table are what docs/results/*.csv holds, and guides state no figure that they lack."""

import json
import re
import shutil

import pandas as pd
import pytest
import results
import results_page
from results_page import PAGE, README, load, rendered, rendered_readme
from scenes.finished_scene import finished_workspace
from scenes.tiny_plant import ROOT

from cotton3dg.io.tables import read_rows

NO_GUIDES = {"results.md", "papers.md", "csv.md"}
NOT_YET: set[str] = set()
"""Guides that are being rewritten and may still state figures of their own."""
RULE = "a rule of geometry: an error of a length is threefold in a volume"
EXCEPTIONS = {("scale.md", "1 %"): RULE, ("scale.md", "3 %"): RULE}
"""Page and figure -> why the figure stands there and not on the page of results."""

GUIDES = sorted(page for page in [README, *(ROOT / "docs").glob("*.md")] if page.name not in NO_GUIDES)
ERROR = re.compile(r"\b(volumes?|heights?|canop(y|ies)|counts?|lengths?)\b.*", re.IGNORECASE)
WRONG = re.compile(r"\b(off|errors?|within|too (small|large)|loses?|lost|missing)\b", re.IGNORECASE)
RUN = re.compile(r"\b(takes?|took|processor time|on the clock|CPU)\b")
FILMED = re.compile(r"\b(film|video|walk|turn|clip)s?\b", re.IGNORECASE)


def sentences(text):
    """Sentences and rows of tables, without code, and without tables that a program wrote."""
    text = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"<!-- accuracy:begin -->.*?<!-- accuracy:end -->", "", text, flags=re.DOTALL)
    text = re.sub(r"^(    .*|#.*)$", "", text, flags=re.MULTILINE)
    text = re.sub(r"(?<!\|)\n(?=[^\n|*-])", " ", text)
    return [part for line in text.splitlines() for part in re.split(r"(?<=[.;:!?]) +(?=[A-Z*`(])", line)]


def figures(text):
    """Errors in % and seconds of a run that a text states, as they are written, with their unit."""
    found = []
    for sentence in sentences(text):
        found += re.findall(r"(?<![\w.])[+-]\d+(?:\.\d+)? %", sentence)
        if ERROR.search(sentence) and WRONG.search(sentence):
            found += re.findall(r"(?<![\w.+-])\d+(?:\.\d+)? %", sentence)
        if RUN.search(sentence) and not FILMED.search(sentence):
            found += re.findall(r"(?<![\w.])\d+(?:\.\d+)? s\b", sentence)
    return [figure for figure in found if figure != "95 %"]


def lacking(text, page):
    """The figures of a text that another page lacks; one without a sign may have any there."""
    there = set(re.findall(r"[+-]?\d+(?:\.\d+)? (?:%|s\b)", page))
    there |= {figure.lstrip("+-") for figure in there}
    return [figure for figure in figures(text) if figure not in there]


@pytest.mark.parametrize("page", [page for page in GUIDES if page.name not in NOT_YET], ids=lambda page: page.name)
def test_a_guide_states_no_figure_that_the_page_of_results_lacks(page):
    wrong = lacking(page.read_text(encoding="utf-8"), PAGE.read_text(encoding="utf-8"))
    assert [figure for figure in wrong if (page.name, figure) not in EXCEPTIONS] == []


def test_figures_are_told_from_other_numbers():
    text = "Volumes are 3.2 % too small.\nA run\ntakes 79 s.\n\n    volume +9.9 %\n\nFilm for 20 to 60 s, 80 % of it."
    assert figures(text) == ["3.2 %", "79 s"]
    assert figures("| odd | 14 of 14 | -10.1 % |\n| 95 % intervals, off |") == ["-10.1 %"]
    assert figures("Print at 100 %. Each volume has a 95 % interval with its error.") == []
    assert lacking("Volumes are off by 3.2 %, -1.0 %. It takes 8 s.", "| -3.2 % | +1.0 % | 8 % |") == ["-1.0 %", "8 s"]


def test_pages_are_what_is_saved():
    tables = load()
    for page, made in ((PAGE, rendered), (README, rendered_readme)):
        text = page.read_text(encoding="utf-8")
        assert text == made(text, tables), f"{page.name} is out of date: make results-page"
    assert set(re.findall(r"<!-- results: (\w+) -->", PAGE.read_text(encoding="utf-8"))) >= {
        *results_page.COMPUTED,
        *(set(tables) - {"accuracy", "sets", "speed"}),
    }
    assert README.read_text(encoding="utf-8").count("<!-- accuracy:begin -->") == 1


def test_every_row_says_when_it_was_measured_and_where_it_comes_from():
    for name, table in load().items():
        wanted = {"source"} if name == "published" else {"date", "version", "source"}
        assert name == "data" or wanted <= {*table.columns}, name
        assert all((table[column] != "").all() for column in wanted & {*table.columns}), name


def plant(**known):
    usual = dict.fromkeys(load()["accuracy"].columns, "")
    usual |= {"set": "odd", "preset": "draft", "bolls": "10", "measured": "10", "found": "10", "false": "0"}
    return {**usual, "date": "2026-01-02", "version": "new", **known}


def tables_of(*plants, sets=()):
    names = load()["sets"].columns
    saved = pd.DataFrame([{**dict.fromkeys(names, ""), **row} for row in sets], columns=names)
    return {"accuracy": pd.DataFrame(plants), "sets": saved}


def test_means_are_of_the_plants_and_an_earlier_version_shows():
    rows = [
        plant(plant="odd-1", volume="+2.00", height="-0.10", volume_held="yes", volume_half="3.0"),
        plant(plant="odd-2", volume="-4.00", measured="12", false="2", volume_held="no", volume_half="5.0"),
        plant(plant="odd-3", preset="standard", date="2025-01-02", version="old"),
    ]
    kept = {"set": "study", "preset": "draft", "plants": "12", "bolls": "192", "found": "191", "false": "1"}
    tables = tables_of(*rows, sets=[{**kept, "volume": "1.2", "date": "2025-03-04", "version": "old"}])
    first, second, third = results_page.sets(tables).splitlines()[2:]
    assert first == "| 12 simulated | `draft` | 191 of 192 (1) |  | 1.2 % |  |  | earlier: 2025-03-04, old |"
    assert "| 20 of 20 (2) | 10.0 % | 3.0 % | 0.1 % |  | 2026-01-02, new |" in second
    assert third.endswith("| 0.0 % |  |  |  | earlier: 2025-01-02, old |")
    assert "|  | 1 of 2 (± 4.0 %) |  |  | 2026-01-02, new |" in results_page.intervals(tables)
    assert "| 12 of" not in results_page.plants(tables)


def test_a_set_that_is_not_all_measured_keeps_its_saved_means():
    kept = {"set": "odd", "preset": "draft", "plants": "2", "bolls": "30", "found": "29", "false": "1"}
    half, whole = [plant(plant="odd-1")], [plant(plant="odd-1"), plant(plant="odd-2")]
    assert "| 29 of 30 (1) |" in results_page.sets(tables_of(*half, sets=[kept]))
    assert "| 20 of 20 (0) |" in results_page.sets(tables_of(*whole, sets=[kept]))


def test_units_stand_in_cells_and_a_zero_has_no_sign():
    table = pd.DataFrame({"volume [%]": ["+1.1", ""], "half [± %]": ["3", "4"], "source": ["a", "b"]})
    assert results_page.as_saved(table, "").splitlines()[2:] == ["| +1.1 % | ± 3 % |", "|  | ± 4 % |"]
    assert [results_page.signed(cell) for cell in ("-0.04", "+0.06", "")] == ["0.0 %", "+0.1 %", ""]


def test_seconds_by_stage_stand_before_those_saved():
    row = plant(set="path-traced", kind="plain", seconds="12", cpu_seconds="20", cores="2", machine="A Processor")
    row["stages"] = "frames=1/1 sfm=2/3 train=5/9 masks=1/2 scale=0.6/1 segment=0.4/1 cluster=1/2 traits=1/1"
    tables = tables_of(row) | {"speed": pd.DataFrame({"plant": ["x"], "all [s]": ["9"], "version": ["old"]})}
    first, second = results_page.speed(tables.copy()).splitlines()[2:]
    assert "| 2 cores of A Processor | 1 (1) s | 2 (3) s | 5 (9) s | 1 (2) s | 1 (1) s | 2 (4) s | 12 (20) s |" in first
    assert second.startswith("| x |") and "| 9 s |" in second


def test_what_has_a_row_of_this_code_is_not_measured_again():
    jobs = [job for job in results.all_jobs(None) if job.set == "odd"]
    rows = pd.DataFrame([plant(plant="odd-1", seconds="100"), plant(plant="odd-2", version="old", seconds="200")])
    left = results.missing(jobs, rows, "new")
    assert [job.plant for job in left] == [f"odd-{number}" for number in range(2, 13)]
    assert results.expected_s(left[0], rows, filmed=True) == 150
    assert results.expected_s(left[0], rows, filmed=False) > 150
    assert results.kind_of("--seed 3 --bolls 4 --boll-kind half_open --things 10 --width 9") == "half open, things 10"


def test_path_traced_plants_are_measured_where_there_is_a_folder_of_them(tmp_path):
    (tmp_path / "plain-a").mkdir()
    (tmp_path / "plain-a" / "truth.json").write_text("{}")
    jobs = [job for job in results.all_jobs(tmp_path) if job.set == "path-traced"]
    assert [(job.plant, job.kind, job.preset) for job in jobs] == [
        ("plain-a", "plain", p) for p in ("draft", "standard")
    ]
    assert not [job for job in results.all_jobs(None) if job.set == "path-traced"]


def test_a_new_row_takes_the_place_of_the_old_one(tmp_path):
    file = tmp_path / "accuracy.csv"
    pd.DataFrame([plant(plant="odd-10"), plant(plant="odd-9", volume="+1.0")]).to_csv(file, index=False)
    results.save(plant(plant="odd-9", volume="-2.0", version="newer"), file)
    results.save(plant(plant="plain-a", set="path-traced"), file)
    rows = results.read_rows(file)
    assert list(rows["plant"]) == ["plain-a", "odd-9", "odd-10"]
    assert list(rows["volume"]) == ["", "-2.0", ""]


def test_a_plant_is_measured_and_leaves_its_row_alone(tmp_path, monkeypatch):
    finished = finished_workspace(tmp_path / "finished")
    rows = read_rows(finished.bolls_csv)
    source = tmp_path / "plants" / "plain-a"
    source.mkdir(parents=True)
    (source / "video.mp4").write_bytes(b"film")
    bolls = [
        {
            "centre_xyz_m": [float(boll[f"{axis}_cm"]) / 100 for axis in "xyz"],
            "convex_volume_cm3": float(boll["volume_cm3"]),
        }
        for boll in rows
    ]
    traits = read_rows(finished.traits_csv)[0]
    truth = {"boll_count": 5, "total_boll_convex_volume_cm3": float(traits["boll_volume_cm3"]) / 1.1}
    truth |= {"plant_height_cm": float(traits["plant_height_cm"]), "canopy_size_cm": 1.0, "stem_base_xyz_m": [0, 0, 0]}
    missed = {"centre_xyz_m": [9, 9, 9], "convex_volume_cm3": 30.0}
    (source / "truth.json").write_text(json.dumps(truth | {"bolls": [*bolls, missed]}))
    (job,) = [job for job in results.all_jobs(source.parent) if (job.set, job.preset) == ("path-traced", "draft")]

    file = tmp_path / "accuracy.csv"
    load()["accuracy"].to_csv(file, index=False)
    monkeypatch.setattr(results, "run_plant", lambda run, preset: 9)
    assert results.do(job, tmp_path / "work", "1-abc", file) == 9
    left = tmp_path / "work" / "1-abc" / "draft" / "plain-a"
    assert (left / "video.mp4").read_bytes() == b"film"

    monkeypatch.setattr(
        results, "run_plant", lambda run, preset: shutil.copytree(finished.root, run, dirs_exist_ok=True) and 0
    )
    assert results.do(job, tmp_path / "work", "1-abc", file) == 0
    assert not left.exists()
    assert len(results.read_rows(file)) == len(load()["accuracy"])
    row = results.read_rows(file).query("version == '1-abc'").iloc[0]
    assert (row["bolls"], row["measured"], row["found"], row["false"]) == ("5", "4", "4", "0")
    assert (row["volume"], row["height"], row["one_boll"]) == ("+10.00", "+0.00", "0.00")
    assert (row["height_held"], row["canopy_held"]) == ("yes", "no")
    assert float(row["volume_half"]) > 0
    assert (row["seconds"], row["cpu_seconds"]) == ("10", "20")
    assert "masks=1.2/2.5" in row["stages"]
    assert "| +10.0 % |" in results_page.plants(load() | {"accuracy": results.read_rows(file)})


def test_a_version_is_of_the_sources_that_a_row_depends_on():
    names = {file.relative_to(results.ROOT).as_posix() for file in results.measuring_sources()}
    for needed in (
        "cotton3dg/cluster/stage.py", "cotton3dg/cluster/same_boll.toml", "cotton3dg/masks/bolls.onnx",
        "cotton3dg/gaussians/rasterizer.py", "cotton3dg/evaluation/match.py", "cotton3dg/simulate/organs.py",
        "native/src/train.cpp", "cotton3dg/train/effects/motion_blur.py",
    ):  # fmt: skip
        assert needed in names
    rooms = {name.split("/")[1] for name in names}
    assert not rooms & {"report", "commands", "cli", "field"}


def test_a_version_follows_the_bytes_and_the_names(tmp_path):
    file = tmp_path / "a.py"
    file.write_text("x = 1\n")
    before = results.version_of([file], tmp_path)
    assert results.version_of([file], tmp_path) == before
    file.write_text("x = 2\n")
    assert results.version_of([file], tmp_path) != before
    file.write_text("x = 1\n")
    assert results.version_of([file.rename(tmp_path / "b.py")], tmp_path) != before
