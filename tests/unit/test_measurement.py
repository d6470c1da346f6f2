# SPDX-License-Identifier: Apache-2.0
"""`measure` and `measure_many` do what the commands `run` and `batch` do, and give tables."""

import html
import math
import subprocess
import sys

import pytest
from scenes.finished_scene import N_BOLLS, finished_workspace
from scenes.small_stages import copying_stage, filmed_plant, replace_stages

import cotton3dg
from cotton3dg import measurement
from cotton3dg.batch import INDEX
from cotton3dg.errors import BadUsage, MissingInput
from cotton3dg.schemas.record import Choices
from cotton3dg.stage import STAGES


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """A finished plant, beside one whose film is missing."""
    folder = tmp_path_factory.mktemp("field")
    finished_workspace(folder / "007")
    (folder / "empty").mkdir()
    return folder


@pytest.fixture
def plant(monkeypatch, tmp_path):
    """A film, and small stages that have no tables."""
    replace_stages(monkeypatch, copying_stage)
    monkeypatch.setattr(measurement, "read_rows", lambda path: [])
    return filmed_plant(tmp_path)


def test_a_plant_has_its_tables_and_its_page(field):
    result = cotton3dg.measure(field / "007")
    (row,) = result.traits.to_dict("records")
    assert (row["plant_id"], row["boll_count"]) == ("007", N_BOLLS)
    assert row["plant_height_low_cm"] < row["plant_height_cm"] < row["plant_height_high_cm"]
    assert math.isnan(row["seed_cotton_g"])
    assert list(result.bolls.boll_id) == [1, 2, 3, 4]
    assert list(result.bolls.qc_flags) == 4 * [""]
    assert set(result.bolls.branch) == {0, *result.branches.branch}
    assert result.report == field / "007" / "report.html"
    assert result.report.is_file()
    assert result.plant.root == field / "007"


def test_a_notebook_shows_the_bolls_and_the_four_traits(field):
    result = cotton3dg.measure(str(field / "007"), quiet=True)
    (row,) = result.traits.to_dict("records")
    height = f"{row['plant_height_cm']:.1f} ({row['plant_height_low_cm']:.1f} to {row['plant_height_high_cm']:.1f})"
    for text in (repr(result), result._repr_html_()):
        assert height in text
        assert "few_frames_registered, orbit_gap" in text
        assert "report.html" in text
    assert '<img src="data:image/jpeg;base64,' in result._repr_html_()
    photos = result.plant.undistorted / "images"
    photos.rename(photos.with_name("gone"))
    try:
        assert "<img" not in result._repr_html_()
        assert height in result._repr_html_()
    finally:
        photos.with_name("gone").rename(photos)


def test_many_plants_are_one_table_with_the_reasons_of_failures(field):
    result = cotton3dg.measure_many(field, jobs=1, quiet=True)
    assert list(result.traits.state) == ["failed", "done"]
    assert list(result.traits.exit_code) == [MissingInput.exit_code, 0]
    assert list(result.traits.plant_id) == ["", "007"]
    assert math.isnan(result.traits.boll_count[0])
    assert len(result.bolls) == N_BOLLS
    assert set(result.branches.plant_id) == {"007"}
    assert result.report == field / INDEX
    reason = result.traits.reason[0]
    assert "no video" in reason
    assert reason in repr(result)
    assert html.escape(reason, quote=False) in result._repr_html_()
    assert "<img" not in result._repr_html_()


def test_options_are_those_of_the_command_line_and_win_as_there(plant, capsys):
    plant.options_file.write_text("[train]\nsteps = 900\n[frames]\ncount = 44\n")
    segment = {"method": "probability", "probability": {"threshold": 0.5}}
    measurement.measure(plant, "draft", train={"steps": 800}, segment=segment)
    assert plant.read_record("segment").options["threshold"] == 0.5
    assert plant.read_record("train").options["steps"] == 800
    assert plant.read_record("train").options["max_side"] == 640
    assert plant.read_record("frames").options["count"] == 44
    said = capsys.readouterr().err
    assert "preset draft (measure)" in said
    assert "train.steps 800 (measure)" in said
    kept = Choices.load(plant.choices_json)
    assert (kept.preset, kept.values["train"]["steps"]) == ("draft", 800)
    measurement.measure(plant, quiet=True)
    assert plant.read_record("train").options["steps"] == 900  # the file wins over the last run
    measurement.measure(plant, reset=True, quiet=True)
    assert plant.read_record("train").options["max_side"] == 960
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "options, words",
    [
        ({"preset": "daft"}, "did you mean draft"),
        ({"trian": {"steps": 3}}, "did you mean train"),
        ({"table_length_cm": 90}, r"of scale; write scale=\{'table_length_cm': 90\}"),
        ({"train": 3000}, r"write it as train=\{'steps': 3000\}"),
        ({"train": {"stepps": 3}}, "did you mean steps"),
        ({"train": {"steps": -1}}, "use at least"),
        ({"segment": {"threshold": 0.5}}, "has no effect with method = lint"),
    ],
)
def test_a_mistaken_option_is_refused_before_anything_is_written(plant, options, words, tmp_path_factory):
    film = tmp_path_factory.mktemp("films") / "p.mp4"
    film.write_text("video")
    for function, path in ((measurement.measure, film), (measurement.measure_many, plant.root.parent)):
        with pytest.raises(BadUsage, match=words):
            function(path, **options)
    assert [path.name for path in film.parent.iterdir()] == ["p.mp4"]
    assert [path.name for path in plant.root.parent.rglob("*")] == [plant.root.name, "video.mp4"]


def test_a_film_gets_its_folder(plant):
    film = (plant.root / "video.mp4").rename(plant.root.parent / "p.mp4")
    result = measurement.measure(film, quiet=True)
    assert result.plant.root == film.with_suffix("")
    assert all(result.plant.read_record(stage).is_ok for stage in STAGES)


def test_run_takes_a_folder_or_film(plant):
    cotton3dg.run(str(plant.root))
    assert all(plant.read_record(stage).is_ok for stage in STAGES)
    with pytest.raises(MissingInput, match="does not exist"):
        cotton3dg.run("no_such_plant")


def test_a_plant_prints_what_it_is(plant):
    assert eval(repr(plant), {"Workspace": cotton3dg.Workspace}).root == plant.root


def test_importing_them_loads_nothing_yet():
    script = "import sys, cotton3dg; print('cotton3dg.measurement' in sys.modules, 'pandas' in sys.modules)"
    assert subprocess.check_output([sys.executable, "-c", script], text=True).split() == ["False", "False"]
