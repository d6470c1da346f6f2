# SPDX-License-Identifier: Apache-2.0
"""Methods that are gone: who names one is told what replaces it, and plants that were run with one stay readable."""

from dataclasses import replace

import pytest
from scenes.small_stages import copying_stage, filmed_plant, replace_stages
from typer.testing import CliRunner

from cotton3dg import pipeline
from cotton3dg.cli.app import app
from cotton3dg.errors import BadUsage
from cotton3dg.options import resolve
from cotton3dg.recorded_options import recorded
from cotton3dg.schemas.record import Choices

NO_LINT = "masks.backend = 'lint' is gone; use bolls"
NO_JOINING = "cluster.method = 'agglomerative' is gone; use votes"
NO_REACH = "is gone with method = agglomerative; use method = votes"
LEFT = {
    "masks": {"backend": "lint", "views": 24},
    "cluster": {"method": "agglomerative", "boll_plys": False, "reach": 0.5},
}
"""Options in the records of a plant that was run with what is gone since."""


@pytest.fixture
def plant(tmp_path, monkeypatch):
    replace_stages(monkeypatch, copying_stage)
    return filmed_plant(tmp_path)


@pytest.fixture(params=[True, False], ids=["choices", "records"])
def old_plant(plant, request):
    """A finished plant whose last run named what is gone: in choices and records, or in records alone."""
    pipeline.run(plant, pipeline.stage_options(plant))
    for stage, options in LEFT.items():
        plant.write_record(replace(plant.read_record(stage), options=options))
    plant.choices_json.unlink()
    if request.param:
        Choices("", LEFT).save(plant.choices_json)
    return plant


def contents(plant):
    return {path: path.read_bytes() for path in sorted(plant.root.rglob("*")) if path.is_file()}


@pytest.mark.parametrize(
    "stage, values, said",
    [
        ("masks", {"backend": "lint"}, NO_LINT),
        ("masks", {"backend": "lint", "views": 24}, NO_LINT),
        ("cluster", {"method": "agglomerative", "reach": 0.5}, NO_JOINING),
        ("cluster", {"method": "dbscan", "reach": 0.5}, f"option cluster.reach {NO_REACH}"),
        ("cluster", {"agglomerative.reach": "0.5"}, f"option cluster.agglomerative.reach {NO_REACH}"),
        ("cluster", {"agglomerative": {"reach": 0.5}}, f"option cluster.agglomerative {NO_REACH}"),
    ],
)
def test_the_refusal_names_what_replaces_it(stage, values, said):
    for layers, asked in (((), values), ((values,), {})):
        with pytest.raises(BadUsage) as refused:
            resolve(stage, *layers, asked=asked)
        assert str(refused.value) == said


@pytest.mark.parametrize(
    "words, said",
    [
        ("masks PLANT --backend lint", NO_LINT),
        ("run PLANT --set masks.backend=lint", NO_LINT),
        ("cluster PLANT --method agglomerative", NO_JOINING),
        ("cluster PLANT --reach 0.5", NO_REACH),
        ("status PLANT --set cluster.agglomerative.reach=0.5", NO_REACH),
    ],
)
def test_what_was_typed_is_refused_in_a_line(plant, words, said):
    told = CliRunner().invoke(app, words.replace("PLANT", str(plant.root)).split())
    assert told.exit_code == 2
    assert told.output.startswith("plant_007: ") and said in told.output and told.output.count("\n") == 1
    assert [path.name for path in plant.root.iterdir()] == ["video.mp4"]


@pytest.mark.parametrize(
    "text, said",
    [
        ('[masks]\nbackend = "lint"\n', NO_LINT),
        ('[cluster]\nmethod = "agglomerative"\n[cluster.agglomerative]\nreach = 0.5\n', NO_JOINING),
        ("[cluster.agglomerative]\nreach = 0.5\n", NO_REACH),
    ],
)
def test_a_file_is_refused_by_its_name(plant, text, said):
    plant.options_file.write_text(text)
    told = CliRunner().invoke(app, ["run", str(plant.root)])
    assert told.exit_code == 2
    assert told.output.startswith("plant_007: cotton3dg.toml: ") and said in told.output


def test_help_does_not_show_the_options_that_are_gone():
    told = CliRunner().invoke(app, ["cluster", "--help"])
    assert "--eps" in told.output and "--reach" not in told.output


def test_the_status_of_an_old_plant_says_what_is_stale_and_why(old_plant):
    before = contents(old_plant)
    told = CliRunner().invoke(app, ["status", str(old_plant.root)])
    assert told.exit_code == 0
    assert "option backend lint -> bolls" in told.output
    assert "cluster.method agglomerative -> votes (default)" in told.output
    assert contents(old_plant) == before


def test_a_run_of_an_old_plant_makes_its_stages_again_with_what_replaces_it(old_plant):
    told = CliRunner().invoke(app, ["run", str(old_plant.root), "--no-report"])
    assert told.exit_code == 0
    assert "changed since the last time: masks.backend lint -> bolls" in told.output
    assert "scale: up to date" in told.output and "masks: starts" in told.output
    assert old_plant.read_record("masks").options["backend"] == "bolls"
    assert old_plant.read_record("cluster").options["method"] == "votes"
    assert all(state.done for state in pipeline.status(old_plant, pipeline.stage_options(old_plant)))


def test_a_record_says_which_stage_to_run_again():
    with pytest.raises(BadUsage) as refused:
        recorded("masks", LEFT["masks"], 21)
    assert str(refused.value) == f"masks was made by an earlier version: {NO_LINT}; run `cotton3dg masks` again"
