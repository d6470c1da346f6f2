# SPDX-License-Identifier: Apache-2.0
"""From a simulated video to traits.csv through the command line, killed once in every stage on the way."""

import csv
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cotton3dg import pipeline
from cotton3dg.commands.simulate import simulate
from cotton3dg.evaluation.plant import evaluate
from cotton3dg.options import resolve
from cotton3dg.workspace import Workspace


def command(plant: Path, *arguments: str) -> list[str]:
    return [sys.executable, "-m", "cotton3dg.cli", "run", str(plant), "--preset", "draft", *arguments]


def killed_in(stage: str, plant: Path) -> list[str]:
    """Run until `stage` has started, kill the process, and return what it said until then."""
    process = subprocess.Popen(command(plant), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    said = []
    assert process.stderr is not None
    for line in process.stderr:
        said.append(line)
        if line.startswith(f"{stage}: starts"):
            process.send_signal(signal.SIGKILL)
            break
    process.stderr.close()
    assert process.wait(60) == -signal.SIGKILL, said
    return said


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plants") / "plant_007"
    simulate(folder, resolve("simulate", {"seed": 5, "bolls": 8, "frames": 64}))
    for stage in pipeline.STAGES:
        killed_in(stage, folder)
    finished = subprocess.run(command(folder), capture_output=True, text=True, check=False)
    assert finished.returncode == 0, finished.stderr
    return Workspace(folder)


def test_nothing_is_left_of_the_killed_runs(plant):
    assert [path.name for path in plant.root.iterdir() if path.name.endswith((".partial", ".old"))] == []
    records = {stage: plant.read_record(stage) for stage in pipeline.STAGES}
    assert {stage: record.status for stage, record in records.items()} == dict.fromkeys(pipeline.STAGES, "ok")


def test_the_traits_are_near_the_truth(plant):
    errors, bolls = evaluate(plant, plant.truth_json)
    measured = {item.trait: item for item in errors}
    assert abs(measured["boll_count"].measured - 8) <= 2
    assert bolls.n_matched >= 6
    assert bolls.median_distance_cm < 1.5
    assert abs(measured["plant_height_cm"].error_pct) < 4
    assert abs(measured["canopy_size_cm"].error_pct) < 8
    assert abs(measured["boll_volume_cm3"].error_pct) < 25


def test_the_row_has_the_columns_of_the_contract(plant):
    header, row = plant.traits_csv.read_text().splitlines()
    assert header.startswith(
        "plant_id,boll_count,boll_count_low,boll_count_high,boll_volume_cm3,boll_volume_low_cm3,boll_volume_high_cm3,"
        "plant_height_cm,plant_height_low_cm,plant_height_high_cm,canopy_size_cm,canopy_size_low_cm,"
        "canopy_size_high_cm,qc_flags,boll_count_error,"
    )
    assert ";" not in row
    cells = dict(zip(header.split(","), row.split(","), strict=True))
    assert cells["plant_id"] == "plant_007"
    blank = {name for name, cell in cells.items() if not cell and name != "qc_flags"}
    weights = {"seed_cotton_g", "seed_cotton_low_g", "seed_cotton_high_g", "lint_g"}
    corrected = {"corrections", *(name for name in cells if name.startswith("original_"))}
    colours = {name for name in cells if name.startswith("lint_") and name not in ("lint_area_cm2", "lint_g")}
    # No plant was weighed, nobody corrected anything, and no card was in view.
    assert blank == weights | corrected | colours


def test_a_second_run_does_nothing(plant):
    before = plant.hashes(*(plant.folder(stage) for stage in pipeline.STAGES))
    again = subprocess.run(command(plant.root), capture_output=True, text=True, check=True)
    options, *stages = again.stderr.splitlines()
    assert options.startswith("options: preset draft (command line)")
    assert stages == [f"{stage}: up to date" for stage in pipeline.STAGES]
    assert plant.hashes(*(plant.folder(stage) for stage in pipeline.STAGES)) == before


def test_a_dry_run_says_why_and_changes_nothing(plant):
    records = {path: path.read_bytes() for path in (plant.root / "records").iterdir()}
    result = subprocess.run(
        command(plant.root, "--dry-run", "--set", "scale.table_length_cm=100"),
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "COLUMNS": "200"},
    )
    lines = dict(line.split(maxsplit=1) for line in result.stdout.splitlines())
    assert lines["train"] == "up to date"
    assert "table_length_cm 120.0 -> 100.0" in lines["scale"]
    assert lines["masks"] == lines["segment"] == "up to date"
    assert lines["cluster"] == "runs: after scale"
    assert lines["traits"] == "runs: after cluster"
    assert {path: path.read_bytes() for path in (plant.root / "records").iterdir()} == records


def test_a_batch_skips_the_finished_plant_and_explains_the_broken_ones(plant):
    folder = plant.root.parent
    broken = {
        "empty": "no video",
        "no_video": "not a video that can be read",
        "odd_options": "frames.count",
        "two_videos": "several videos",
    }
    for name in broken:
        (folder / name).mkdir()
    (folder / "no_video" / "walk.mp4").write_bytes(b"this is no video" * 100)
    (folder / "odd_options" / "walk.mp4").touch()
    (folder / "odd_options" / "cotton3dg.toml").write_text("[frames]\ncount = 1\n")
    for name in "ab":
        (folder / "two_videos" / f"{name}.mp4").touch()
    tables = []
    for options in ((), ("--only-failed", "--jobs", "1")):
        done = subprocess.run(
            [sys.executable, "-m", "cotton3dg.cli", "batch", str(folder), "--preset", "draft", *options],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 8, done.stderr
        with (folder / "batch.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert [row["folder"] for row in rows] == [*sorted(broken), "plant_007"]
        for row in rows[:-1]:
            assert broken[row["folder"]] in row["reason"], row
            assert f"{row['folder']}: {row['state']}: {row['reason']}" in done.stdout
        tables.append((folder / "batch.csv").read_bytes())
    with plant.traits_csv.open(newline="") as file:
        (own,) = csv.DictReader(file)
    assert {name: rows[-1][name] for name in own} == own
    assert tables[0] == tables[1]
    assert (folder / "batch_bolls.csv").read_bytes() == plant.bolls_csv.read_bytes()
