# SPDX-License-Identifier: Apache-2.0
"""The command line in processes of their own: help, exit codes, one-line errors."""

import os
import re
import subprocess
import sys

import pytest
from scenes.doc_commands import COMMANDS
from typer.testing import CliRunner

from cotton3dg.cli.app import COMMANDS as PANELS
from cotton3dg.cli.app import app
from cotton3dg.option_rules import places
from cotton3dg.options import PRESETS, ScaleOptions
from cotton3dg.pipeline import stage_options
from cotton3dg.planning.cost import Machine, estimate_costs, sum_seconds
from cotton3dg.stage import Footage

METHODS = places(ScaleOptions)[0].item.metadata["choices"]
VERBS = (
    "Measure Open Say Judge Remove Make Sort Save Compare Correct Film Train Print Fit Try Simulate Pack Choose Find"
    " Lift Join"
)


def cotton3dg(*arguments, **keywords):
    return subprocess.run(
        [sys.executable, "-m", "cotton3dg.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        **keywords,
    )


def assert_one_line(result, code, *words):
    assert result.returncode == code, result.stderr
    last = result.stderr.strip().splitlines()[-1]
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in last


@pytest.fixture
def plant(tmp_path):
    folder = tmp_path / "plant_007"
    folder.mkdir()
    return folder


def test_help_names_units_and_the_papers_values():
    result = cotton3dg("train", "--help", env={**os.environ, "COLUMNS": "200"})
    assert result.returncode == 0
    assert "--max-side" in result.stdout
    assert "px; paper: 960" in result.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_verb_and_no_type_or_empty_default_for_flags(name):
    told = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "200"})
    assert told.exit_code == 0
    assert COMMANDS[name].help.split()[0] in VERBS.split()
    for words in ("<bool>", "none)]", "[default: (", "False"):
        assert words not in told.stdout


def test_help_groups_commands_by_what_people_do():
    told = CliRunner().invoke(app, ["--help"]).stdout
    places = [told.index(f"─ {group} ─") for group in PANELS]
    assert next(iter(PANELS)) == "Measure" and places == sorted(places)
    assert set(COMMANDS) == {name for commands in PANELS.values() for name in commands}


def test_the_help_of_run_gives_the_minutes_of_each_preset():
    told = CliRunner().invoke(app, ["run", "--help"], env={"COLUMNS": "120"}).stdout
    stated = dict(re.findall(r"(\w+) (\d+)[,\s]", told[told.index("Minutes") :].split(":", 1)[1]))
    film = Footage(900, 1920, 1080)
    costs = {name: sum_seconds(estimate_costs(stage_options(None, name), film, Machine(2.0)), 2.0) for name in PRESETS}
    assert stated == {name: f"{seconds / 60:.0f}" for name, seconds in costs.items()}


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("run x --preset pa", ["paper", "paper1", "paper2"]),
        ("run x --from s", ["sfm", "scale", "segment"]),
        ("run x --until tr", ["train", "traits"]),
        ("run x --set scale.me", [f"scale.method={name}" for name in METHODS]),
        ("run x --set train.max_s", ["train.max_side="]),
        ("run x --set segment.thr", ["segment.threshold="]),
        ("masks x --backend s", ["sam"]),
        ("scale x --method all", ["all", "all-sections"]),
        ("export x --format f", ["frictionless", "fieldbook"]),
        ("render x --format ", ["mp4", "png", "jpg"]),
        ("batch x --engine ", ["local", "slurm"]),
    ],
)
def test_tab_completes_choices(line, found):
    settings = {"_COTTON3DG_COMPLETE": "complete_zsh", "_TYPER_COMPLETE_ARGS": f"cotton3dg {line}"}
    told = CliRunner().invoke(app, [], prog_name="cotton3dg", env=settings, complete_var="_COTTON3DG_COMPLETE")
    assert set(re.findall(r'"([^"]+)"', told.stdout)) == set(found)


def test_a_word_that_is_no_choice_is_still_answered_in_a_line(plant):
    (plant / "video.mp4").touch()
    assert_one_line(cotton3dg("run", plant, "--preset", "drfat"), 2, "did you mean draft?")


def test_the_version_has_a_short_option():
    assert cotton3dg("-V").stdout == cotton3dg("--version").stdout != ""


def test_help_imports_nothing_heavy():
    script = (
        "import sys, cotton3dg.cli.app; from typer.testing import CliRunner;"
        "assert CliRunner().invoke(cotton3dg.cli.app.app, ['--help']).exit_code == 0;"
        "print([m for m in ('numpy', 'torch', 'open3d', 'pycolmap', 'cv2', 'pandas', 'scipy') if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_status_imports_no_library_that_computes(plant):
    (plant / "video.mp4").write_text("x")
    script = (
        "import sys, cotton3dg.cli.app; from typer.testing import CliRunner;"
        "assert CliRunner().invoke(cotton3dg.cli.app.app, ['status', sys.argv[1]]).exit_code == 0;"
        "print([m for m in ('torch', 'open3d', 'pycolmap', 'cv2', 'pandas', 'scipy') if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", script, plant], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_unknown_command_and_option(plant):
    assert cotton3dg("harvest").returncode == 2
    assert cotton3dg("run", plant, "--fast").returncode == 2


def test_empty_folder(plant):
    assert_one_line(cotton3dg("run", plant), 2, "plant_007: ", "no video")


def test_missing_folder(plant):
    result = cotton3dg("run", plant / "nowhere")
    assert_one_line(result, 2, "nowhere does not exist; look at its spelling")
    assert result.stderr.count("nowhere") == 1


def test_bad_options(plant):
    (plant / "video.mp4").touch()
    assert_one_line(cotton3dg("run", plant, "--set", "train.steps"), 2, "STAGE.OPTION=VALUE")
    assert_one_line(cotton3dg("run", plant, "--set", "train.steps=-1"), 2, "train.steps")
    assert_one_line(cotton3dg("run", plant, "--preset", "magic"), 2, "magic")
    assert_one_line(cotton3dg("run", plant, "--until", "harvest"), 2, "harvest")
    (plant / "cotton3dg.toml").write_text("[trian]\n")
    assert_one_line(cotton3dg("run", plant), 2, "cotton3dg.toml", "trian", "did you mean train?")


def test_video_that_is_none(plant):
    (plant / "video.mp4").write_text("no video at all")
    assert_one_line(cotton3dg("run", plant), 4, "plant_007: ", "video.mp4")


def test_status_of_a_new_plant(plant):
    (plant / "video.mp4").write_text("x")
    result = cotton3dg("status", plant, "--json")
    assert result.returncode == 0
    assert result.stdout.count('"missing"') == 8


def test_tables_are_evaluated_and_markers_printed(tmp_path):
    (tmp_path / "batch.csv").write_text("plant_id,boll_count\na,9\nb,11\nc,4\n")
    (tmp_path / "truth.csv").write_text("plant_id,boll_count\na,10\nb,10\nd,4\n")
    result = cotton3dg(
        "evaluate", tmp_path / "batch.csv", "--truth", tmp_path / "truth.csv", "--out", tmp_path / "scores"
    )
    assert result.returncode == 0, result.stderr
    assert "10.00" in result.stdout
    assert "truth only): d" in result.stdout
    assert (tmp_path / "scores" / "scatter_boll_count.png").is_file()
    assert_one_line(cotton3dg("evaluate", tmp_path / "batch.csv"), 2, "--truth")
    result = cotton3dg("markers", tmp_path / "sheet.pdf", "--board", "3x4", "--marker-cm", "6")
    assert result.returncode == 0, result.stderr
    assert "scale.board=3x4" in result.stdout
    assert_one_line(cotton3dg("markers", tmp_path / "sheet.doc"), 2, ".pdf")
