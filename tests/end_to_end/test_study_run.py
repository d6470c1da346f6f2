# SPDX-License-Identifier: Apache-2.0
"""A study of a tiny simulated plant, interrupted and resumed, and a run within a time, through the command line."""

import csv
import json
import os
import signal
import subprocess
import sys

from cotton3dg.errors import BadUsage

# A test run in the background may ignore Ctrl-C, and so would all that it starts.
signal.signal(signal.SIGINT, signal.default_int_handler)


def command(*arguments):
    return [sys.executable, "-m", "cotton3dg.cli", *map(str, arguments)]


def run(cache, *arguments):
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    return subprocess.run(
        command(*arguments), capture_output=True, text=True, check=False, env=environment, timeout=900
    )


def test_a_study_resumes_after_ctrl_c_and_leaves_the_plant_alone(tiny_plant, tmp_path):
    plant = tiny_plant.root
    before = tiny_plant.hashes(tiny_plant.folder("train"), tiny_plant.folder("traits"))
    arguments = ("study", plant, "--sweep", "steps=50,100")
    interrupted = subprocess.Popen(command(*arguments), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert interrupted.stderr is not None
    with interrupted.stderr:
        for line in interrupted.stderr:
            if line.startswith("train: starts"):
                interrupted.send_signal(signal.SIGINT)
                said = interrupted.stderr.read()
                break
    assert interrupted.wait(300) == 130 and "the same command continues" in said
    assert not list(plant.rglob("*.partial"))

    done = run(tmp_path, *arguments)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("train: starts") == 1
    assert "sfm: starts" not in done.stderr
    assert "masks: starts" not in done.stderr
    assert done.stderr.count("segment: starts") == 2  # of each model; that of 400 steps is segmented
    with (plant / "study" / "study.csv").open(newline="") as file:
        rows = {(row["sweep"], row["setting"]): row for row in csv.DictReader(file)}
    steps = [rows["steps", value] for value in ("50", "100", "400")]
    assert set(rows) == {
        ("base", "draft"), ("steps", "50"), ("steps", "100"), ("steps", "400"),
    }  # fmt: skip
    assert {row["state"] for row in rows.values()} == {"done"}
    assert {row["reference"] for row in rows.values()} == {"truth"}
    for measure in ("full_psnr_db", "plant_psnr_db"):
        values = [float(row[measure]) for row in steps]
        assert values == sorted(values) and values[0] < values[-1], measure
    passed = [tiny_plant.study_setting("steps", value).read_record("train") for value in ("50", "100")]
    assert 0 < passed[0].cpu_seconds < passed[1].cpu_seconds
    assert all(float(row["fps"]) > 0 and float(row["peak_memory_mib"]) > 50 for row in rows.values())
    assert "Table 2" in (plant / "study" / "study.md").read_text()
    assert (plant / "study" / "study.png").stat().st_size > 5000
    assert tiny_plant.hashes(tiny_plant.folder("train"), tiny_plant.folder("traits")) == before
    # Shared results take up no space of their own.
    shared = plant / "study" / "base" / "draft" / "frames" / "000000.jpg"
    assert shared.samefile(plant / "frames" / "000000.jpg")

    again = run(tmp_path, *arguments)
    assert again.returncode == 0 and "starts" not in again.stderr
    with (plant / "study" / "study.csv").open(newline="") as file:
        assert {(row["sweep"], row["setting"]): row for row in csv.DictReader(file)} == rows


def test_a_run_within_a_time_obeys_the_plants_options_and_says_what_it_chose(tiny_plant, tmp_path):
    plant = tiny_plant.root
    done = run(tmp_path, "run", plant, "--time-budget", "10m", "--no-report", "--set", "train.sh_degree=1")
    assert done.returncode == 0, done.stderr
    assert "measuring this machine once" in done.stderr
    assert "32 images of 384 px, 400 steps, 30,000 Gaussians" in done.stderr
    assert "starts" not in done.stderr  # all is as the plant's cotton3dg.toml wants it
    assert json.loads((plant / "records" / "time_budget.json").read_text())["budget_s"] == 600
    planned = run(tmp_path, "run", plant, "--time-budget", "10m", "--dry-run")
    assert planned.returncode == 0 and "measuring" not in planned.stderr and "frames" in planned.stdout


def test_what_cannot_be_is_told_in_a_line(tiny_plant, tmp_path):
    for arguments, words in (
        (("study", "--sweep", "colour"), "sweep 'colour' is unknown"),
        (("study", "--time-budget", "soon"), "time budget 'soon'"),
        (("run", "--time-budget", "5m", "--preset", "paper"), "--time-budget chooses"),
    ):
        name, *others = arguments
        done = run(tmp_path, name, tiny_plant.root, *others)
        assert done.returncode == BadUsage.exit_code, done.stderr
        assert words in done.stderr.splitlines()[-1]
