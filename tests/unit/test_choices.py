# SPDX-License-Identifier: Apache-2.0
"""What a person chose of the options stays chosen: precedence, what is kept, what is said of it; with small stages."""

import json
import os
from dataclasses import replace

import pytest
from scenes.small_stages import MODULES, copying_stage, filmed_plant, replace_stages

from cotton3dg import pipeline, slurm
from cotton3dg.batch import Batch
from cotton3dg.choices import Asked, choose, option_files
from cotton3dg.cli.app import app
from cotton3dg.errors import BadUsage
from cotton3dg.options import PRESET_VALUES, STAGE_OPTIONS
from cotton3dg.schemas.record import Choices
from cotton3dg.stage import stage_of
from cotton3dg.workspace import Workspace

DONE = dict.fromkeys(pipeline.STAGES, "done")


@pytest.fixture(autouse=True)
def stages(monkeypatch):
    replace_stages(monkeypatch, copying_stage)


@pytest.fixture
def plant(tmp_path):
    """Two folders below `field_2026`."""
    folder = tmp_path / "field_2026" / "row_3"
    folder.mkdir(parents=True)
    return filmed_plant(folder)


@pytest.fixture
def cotton3dg(capsys):
    """Runs a command in this process; returns its exit code, and the lines that it printed to either place."""

    def run(*words):
        capsys.readouterr()
        code = app(list(map(str, words)), standalone_mode=False)
        said = capsys.readouterr()
        return code or 0, said.out.splitlines(), said.err.splitlines()

    return run


@pytest.fixture
def stale(cotton3dg):
    """What a bare `run` would do: stage -> why."""

    def reasons(plant, *words):
        code, out, _ = cotton3dg("run", plant.root, "--dry-run", *words)
        assert code == 0
        return {line.split()[0]: line.split("runs: ")[1] for line in out if "runs: " in line}

    return reasons


def options_line(err):
    return next((line.removeprefix("options: ") for line in err if line.startswith("options: ")), "")


def change_line(err):
    start = "changed since the last time: "
    return next((line.removeprefix(start) for line in err if line.startswith(start)), "")


def test_a_run_with_a_preset_is_done_for_status_check_and_the_same_command(plant, cotton3dg, stale):
    assert cotton3dg("run", plant.root, "--preset", "draft")[0] == 0
    assert stale(plant) == {}
    _, out, err = cotton3dg("status", plant.root)
    assert sum("done with draft" in line for line in out) == len(pipeline.STAGES)
    assert err == ["options: preset draft (last run)"]
    _, out, _ = cotton3dg("status", plant.root, "--json")
    entries = {entry["stage"]: entry for entry in json.loads("\n".join(out))}
    assert {name: entry["state"] for name, entry in entries.items()} == DONE
    assert {entry["preset"] for entry in entries.values()} == {"draft"}
    assert entries["train"]["options"] == PRESET_VALUES["draft"]["train"]
    _, _, err = cotton3dg("run", plant.root)
    assert [line for line in err if line.endswith(": up to date")] == [f"{name}: up to date" for name in DONE]


def test_without_choices_nothing_is_said(plant, cotton3dg):
    _, _, err = cotton3dg("run", plant.root)
    assert options_line(err) == change_line(err) == ""
    assert Choices.load(plant.choices_json) == Choices()
    _, out, err = cotton3dg("status", plant.root)
    assert not err
    assert not any(" with " in line for line in out)


@pytest.mark.parametrize(
    "stage, flags, said",
    [
        ("scale", ("--table-length-cm", 100), "scale.table_length_cm 100"),
        ("masks", ("--backend", "import"), "masks.backend import"),
        ("segment", ("--method", "probability", "--threshold", 0.9), "segment.method probability"),
        ("traits", ("--excel",), "traits.excel true"),
    ],
)
def test_what_a_stage_was_given_stays(plant, cotton3dg, stale, stage, flags, said):
    cotton3dg("run", plant.root)
    _, _, err = cotton3dg(stage, plant.root, *flags)
    assert f"{said} (command line)" in options_line(err)
    assert f" -> {said.split()[-1]}" in change_line(err)
    made = plant.read_record(stage).options
    assert stage not in stale(plant)
    _, _, err = cotton3dg("run", plant.root)
    assert f"{said} (last run)" in options_line(err)
    assert change_line(err) == ""
    assert plant.read_record(stage).options == made
    _, _, err = cotton3dg("status", plant.root, "--reset")
    assert change_line(err).endswith("(--reset)")
    assert set(stale(plant, "--reset")) >= {stage}


def test_an_interrupted_run_goes_on_as_it_was_asked_for(plant, cotton3dg, monkeypatch):
    def interrupted(workspace, options, progress):
        raise KeyboardInterrupt

    train = stage_of("train")
    monkeypatch.setattr(MODULES["train"], "STAGE", type(train)(**(vars(train) | {"run": interrupted})))
    code, _, _ = cotton3dg("run", plant.root, "--preset", "draft", "--set", "scale.table_length_cm=100")
    assert code == 130
    assert plant.read_record("train") is None
    monkeypatch.setattr(MODULES["train"], "STAGE", train)
    cotton3dg("run", plant.root)
    assert plant.read_record("train").options["steps"] == 1500
    assert plant.read_record("scale").options["table_length_cm"] == 100


def test_what_is_refused_leaves_nothing(plant, cotton3dg):
    for words in (("--set", "train.steps=-1"), ("--preset", "daft"), ("--set", "masks.weights=a.onnx,1")):
        code, _, err = cotton3dg("run", plant.root, *words, *(("--until", "harvest") if "masks" in words[1] else ()))
        assert code == 2
        assert len(err) == 1
    assert not plant.choices_json.exists()
    assert sorted(path.name for path in plant.root.iterdir()) == ["video.mp4"]


def write(folder, text):
    (folder / "cotton3dg.toml").write_text(text)


def test_the_nearest_file_wins_and_all_above_are_read(plant, cotton3dg, tmp_path):
    field = tmp_path / "field_2026"
    write(field, "[scale]\ntable_length_cm = 100\ntable_width_cm = 50\n[traits]\ntube_height_cm = 5\n")
    write(field / "row_3", "[scale]\ntable_width_cm = 40\n[frames]\ncount = 80\n")
    write(plant.root, "[frames]\ncount = 70\n")
    _, _, err = cotton3dg("run", plant.root, "--set", "traits.tube_height_cm=6")
    assert options_line(err).split(", ") == [
        "frames.count 70 (cotton3dg.toml)",
        "scale.table_length_cm 100 (cotton3dg.toml of field_2026)",
        "scale.table_width_cm 40 (cotton3dg.toml of row_3)",
        "traits.tube_height_cm 6 (command line)",
    ]
    assert plant.read_record("frames").options["count"] == 70
    assert Choices.load(plant.choices_json) == Choices("", {"traits": {"tube_height_cm": 6.0}})


@pytest.mark.parametrize("command", ["run", "status", "scale", "batch"])
def test_every_command_reads_the_folders_above(plant, cotton3dg, tmp_path, command):
    write(tmp_path / "field_2026", "[scale]\ntable_length_cm = 99\n")
    cotton3dg("run", plant.root)
    write(tmp_path / "field_2026", "[scale]\ntable_length_cm = 100\n")
    if command == "batch":
        work = Batch(plant.root.parent)
        (plant.root.parent / "batch.csv").write_text("folder,state,exit_code,reason\nplant_007,done,0,\n")
        (result,) = slurm.status(work, [plant.root])
        assert (result.state, result.reason) == ("stale", "scale: option table_length_cm 99.0 -> 100.0")
        return
    _, _, err = cotton3dg(command, plant.root)
    assert options_line(err) == "scale.table_length_cm 100 (cotton3dg.toml of field_2026)"
    assert change_line(err) == "scale.table_length_cm 99 -> 100 (cotton3dg.toml of field_2026)"
    assert plant.read_record("scale").options["table_length_cm"] == (99 if command == "status" else 100)


def test_a_link_to_a_plant_lies_where_it_is(plant, tmp_path):
    other = tmp_path / "other_field"
    other.mkdir()
    write(other, "[frames]\ncount = 55\n")
    (other / "plant").symlink_to(plant.root)
    assert choose(Workspace(other / "plant")).options["frames"].count == 55


def test_the_search_ends_at_home_and_where_anybody_may_write(tmp_path, monkeypatch):
    plant = tmp_path / "home" / "field" / "plant"
    plant.mkdir(parents=True)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert [file.parent for file in option_files(plant)] == [tmp_path / "home", plant.parent, plant]
    monkeypatch.setenv("HOME", str(tmp_path / "elsewhere"))
    assert tmp_path / "cotton3dg.toml" in option_files(plant)
    (tmp_path / "home" / "field").chmod(0o1777)
    assert [file.parent for file in option_files(plant)] == [plant]
    monkeypatch.chdir(plant)
    assert [str(file) for file in option_files(os.curdir)] == [str(plant / "cotton3dg.toml")]


def test_a_broken_file_above_is_named(plant, cotton3dg, tmp_path):
    for text in ("[trian]\n", 'preset = "daft"\n', "preset = 3\n", "[scale\n"):
        write(tmp_path / "field_2026", text)
        code, _, err = cotton3dg("status", plant.root)
        assert code == 2
        assert err[-1].startswith("plant_007: field_2026/")


def test_a_preset_may_stand_in_a_file(plant, cotton3dg, stale, tmp_path):
    write(tmp_path / "field_2026", 'preset = "draft"\n[train]\nsteps = 1600\n')
    _, _, err = cotton3dg("run", plant.root)
    from_field = "(cotton3dg.toml of field_2026)"
    assert options_line(err) == f"preset draft {from_field}, train.steps 1600 {from_field}"
    assert stale(plant) == {}
    _, _, err = cotton3dg("status", plant.root, "--preset", "paper")
    assert options_line(err).startswith("preset paper (command line), train.steps 1600")
    write(plant.root, 'preset = "paper"\n')
    assert options_line(cotton3dg("status", plant.root)[2]).startswith(
        "preset paper (cotton3dg.toml), train.steps 1600"
    )


def test_a_file_that_is_gone_gives_nothing_more_and_that_is_said(plant, cotton3dg):
    write(plant.root, 'preset = "draft"\n[scale]\ntable_length_cm = 100\n')
    cotton3dg("run", plant.root)
    (plant.root / "cotton3dg.toml").unlink()
    _, _, err = cotton3dg("run", plant.root)
    assert options_line(err) == ""
    assert change_line(err).startswith("frames.count 60 -> 100, ")
    assert "scale.table_length_cm 100 -> 0" in change_line(err)
    assert change_line(err).endswith(" (default)")


def test_a_preset_and_a_reset_begin_anew(plant, cotton3dg):
    cotton3dg("run", plant.root, "--preset", "draft", "--set", "scale.table_length_cm=100")
    _, _, err = cotton3dg("run", plant.root, "--reset", "--set", "frames.count=60")
    assert options_line(err) == "frames.count 60 (command line)"
    assert "scale.table_length_cm 100 -> 0" in change_line(err)
    assert change_line(err).endswith(" (--reset)")
    _, _, err = cotton3dg("run", plant.root, "--preset", "paper")
    assert "frames.count 60 -> 150" in change_line(err)
    assert change_line(err).endswith("(--preset paper)")
    assert options_line(cotton3dg("status", plant.root)[2]) == "preset paper (last run)"
    cotton3dg("run", plant.root, "--preset", "standard")
    assert Choices.load(plant.choices_json) == Choices()


def test_stages_that_a_new_beginning_does_not_run_stay_as_they_were_made(plant, cotton3dg, stale):
    cotton3dg("run", plant.root, "--preset", "draft", "--set", "traits.plant_id=A-17")
    cotton3dg("train", plant.root, "--preset", "paper")
    cotton3dg("run", plant.root)
    counts = [plant.read_record(stage).options for stage in ("frames", "train", "masks", "traits")]
    assert [counts[0]["count"], counts[1]["steps"], counts[2]["views"]] == [60, 30_000, 24]
    assert counts[3]["plant_id"] == "A-17"
    assert stale(plant) == {}


def test_the_first_stages_of_a_new_plant_choose_for_the_others(plant, cotton3dg):
    cotton3dg("run", plant.root, "--preset", "draft", "--until", "sfm")
    cotton3dg("run", plant.root)
    assert plant.read_record("train").options["steps"] == 1500


def test_options_of_a_method_wait_while_another_is_chosen(plant, cotton3dg):
    cotton3dg("run", plant.root, "--set", "segment.method=probability", "--set", "segment.threshold=0.9")
    cotton3dg("segment", plant.root, "--method", "lift")
    cotton3dg("segment", plant.root, "--method", "probability")
    assert plant.read_record("segment").options["threshold"] == 0.9


def earlier(plant):
    """The plant as an earlier version left it."""
    plant.choices_json.unlink()


def test_a_plant_of_an_earlier_version_is_what_its_records_say(plant, cotton3dg, stale):
    cotton3dg("run", plant.root, "--preset", "draft", "--set", "scale.table_length_cm=100")
    earlier(plant)
    assert stale(plant) == {}
    _, _, err = cotton3dg("status", plant.root)
    assert err == ["options: preset draft (last run), scale.table_length_cm 100 (last run)"]
    plant = Workspace(plant.root.rename(plant.root.with_name("plant_008")))
    _, _, err = cotton3dg("run", plant.root)
    assert change_line(err) == "traits.plant_id plant_007 -> plant_008 (the folder's name)"
    assert stale(plant) == {}


def test_a_former_default_is_no_choice(plant, cotton3dg):
    cotton3dg("run", plant.root)
    earlier(plant)
    record = plant.read_record("scale")
    sides = {"table_length_cm": 120.0, "table_width_cm": 50.0}
    plant.write_record(replace(record, stage_version=0, options=record.options | sides))
    _, _, err = cotton3dg("status", plant.root)
    assert err == ["options: scale.table_width_cm 50 (last run)"]


def test_a_preset_is_named_only_where_all_that_it_says_was_run(plant, cotton3dg):
    cotton3dg("run", plant.root, "--set", "frames.count=60", "--until", "sfm")
    earlier(plant)
    assert options_line(cotton3dg("status", plant.root)[2]) == "frames.count 60 (last run)"


@pytest.mark.parametrize("preset", PRESET_VALUES)
def test_each_preset_is_recognised(plant, preset):
    pipeline.run(plant, pipeline.stage_options(plant, preset))
    assert Choices.load(plant.choices_json) == Choices("" if preset == "standard" else preset)


@pytest.mark.parametrize(
    "text",
    [
        "{half",
        "[]",
        '{"preset": "daft"}',
        '{"values": {"train": {"stepz": 3}, "harvest": {"a": 1}, "scale": {"table_length_cm": -5}}}',
    ],
)
def test_what_cannot_be_used_of_what_was_kept_is_no_obstacle(plant, cotton3dg, text):
    cotton3dg("run", plant.root)
    plant.choices_json.write_text(text)
    assert cotton3dg("status", plant.root)[0] == 0
    assert cotton3dg("run", plant.root)[0] == 0


def test_a_program_gets_what_it_states_and_the_next_run_begins_with_it(plant, cotton3dg, stale):
    cotton3dg("run", plant.root, "--preset", "draft")
    assert pipeline.stage_options(plant)["frames"].count == 60
    stated = pipeline.stage_options(plant, "standard", {"train": {"steps": 900}})
    assert stated["frames"].count == STAGE_OPTIONS["frames"]().count
    pipeline.run(plant, stated)
    assert stale(plant) == {}
    pipeline.run(plant, pipeline.stage_options(plant, "paper"), ("train",))
    assert Choices.load(plant.choices_json).values["train"]["steps"] == 30_000
    assert plant.read_record("frames").options["count"] == choose(plant).options["frames"].count == 100


def test_what_a_time_budget_takes_is_kept_and_the_next_one_takes_anew(plant):
    taken = Asked(values={"scale": {"table_length_cm": "100"}}, budgeted={"frames": {"count": 80}})
    first = choose(plant, taken)
    assert first.summary() == "frames.count 80 (--time-budget), scale.table_length_cm 100 (command line)"
    pipeline.run(plant, first.options, choices=first.to_keep(pipeline.STAGES))
    assert choose(plant).options == first.options
    again = choose(plant, Asked(budgeted={"frames": {"count": 90}}))
    assert again.options["frames"].count == 90
    assert "100 -> 0 (--time-budget)" in again.changes(pipeline.STAGES)


def test_a_batch_passes_only_what_it_is_given(tmp_path, cotton3dg, monkeypatch):
    filmed_plant(tmp_path)
    given = []
    monkeypatch.setattr(Batch, "run", lambda self, plants: given.append(self.arguments) or [])
    cotton3dg("batch", tmp_path)
    cotton3dg("batch", tmp_path, "--preset", "draft", "--set", "frames.count=9", "--no-report")
    cotton3dg("batch", tmp_path, "--reset")
    assert given == [[], ["--set", "frames.count=9", "--preset", "draft", "--no-report"], ["--reset"]]


def test_the_status_of_a_batch_is_that_of_its_plants(plant, cotton3dg):
    field = plant.root.parent
    cotton3dg("run", plant.root, "--preset", "draft")
    (field / "batch.csv").write_text("folder,state,exit_code,reason\nplant_007,done,0,\n")
    code, out, _ = cotton3dg("batch", field, "--status")
    assert (code, out[1].split(), out[2]) == (0, ["plant_007", "done"], "1 of 1 plants done")
    reason = "option count 60 -> 100"
    code, out, _ = cotton3dg("batch", field, "--status", "--reset")
    assert (code, out[1].split(maxsplit=2)) == (8, ["plant_007", "stale", f"frames: {reason}"])
    _, own, _ = cotton3dg("status", plant.root, "--reset")
    assert own[1].split()[:2] == ["frames", "stale"] and reason in own[1]


def test_the_status_of_a_batch_that_has_not_run_is_that_of_its_plants(plant, cotton3dg):
    code, out, _ = cotton3dg("batch", plant.root.parent, "--status")
    assert (code, out[1].split(maxsplit=2)) == (8, ["plant_007", "missing", "frames: no finished result"])
    assert out[2] == "0 of 1 plants done"
    _, out, _ = cotton3dg("batch", plant.root.parent, "--status", "--json")
    (entry,) = json.loads("\n".join(out))
    assert (entry["folder"], entry["state"]) == ("plant_007", "missing")
    assert [path.name for path in plant.root.parent.iterdir()] == ["plant_007"]


def test_a_refusal_names_the_file_whose_values_it_refuses(plant):
    def refusal(*words):
        with pytest.raises(BadUsage) as refused:
            choose(plant, Asked(values={"train": dict(words)} if words else {}))
        return str(refused.value)

    field = plant.root.parents[1]
    (field / "cotton3dg.toml").write_text("[segment]\nthreshold = 0.8\n[train]\nsteps = 70\n")
    plant.options_file.write_text('[segment]\nmethod = "probability"\n')
    assert choose(plant).options["train"].steps == 70
    assert refusal(("stepps", 3)).startswith("option train.stepps is unknown")
    plant.options_file.write_text(plant.options_file.read_text() + "[train]\nstepps = 80\n")
    assert refusal().startswith("cotton3dg.toml: option train.stepps is unknown; did you mean steps")
    plant.options_file.unlink()
    assert refusal().startswith("cotton3dg.toml of field_2026: segment.threshold has no effect")
    (field / "cotton3dg.toml").write_text("[train]\nsteps = -70\n")
    assert refusal().startswith("cotton3dg.toml of field_2026: train.steps = -70")
    assert refusal(("max_side", 100)).startswith("cotton3dg.toml of field_2026: train.steps = -70")
