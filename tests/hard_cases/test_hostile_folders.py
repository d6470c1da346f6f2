# SPDX-License-Identifier: Apache-2.0
"""Hard cases 44 and 52: folders with hostile names, and two processes in one folder."""

from __future__ import annotations

import csv
import multiprocessing
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from cotton3dg.batch import Batch, find_plants, saved_results
from cotton3dg.errors import EnvironmentUnusable
from cotton3dg.workspace import Workspace

NAMES = (
    "-x", "--help", "a:b", "%d", "two words", "it's", 'double"quote', "new\nline", "semi;colon", "$(touch x)",
    "`touch x`", "pipe|", "=1+1", "@SUM(1)", "<img src=x onerror=alert(1)>", "{{7*7}}", "ünïcödé", "back\\slash", "a,b",
    "*", "&amp;", "~",
)  # fmt: skip


def rows_of(field: Path) -> list[dict[str, str]]:
    with (field / "batch.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_case_44_hostile_folders_are_only_folders(tmp_path: Path) -> None:
    """Each plant is run and told of in the table and on the page; the runs are stood in for by one that says no."""
    for name in NAMES:
        (tmp_path / name).mkdir()
    say_no = "import os, sys; sys.exit(1 if os.path.isdir(sys.argv[1]) and sys.argv[2:] == ['--wait'] else 2)"
    work = Batch(tmp_path, jobs=2, tell=lambda line: None, command=[sys.executable, "-c", say_no])
    assert [result.exit_code for result in work.run(find_plants(tmp_path))] == [1] * len(NAMES)
    rows = rows_of(tmp_path)
    assert sorted(row["folder"].removeprefix("'") for row in rows) == sorted(NAMES)
    assert all(row["folder"][0] not in "=+-@" for row in rows)
    assert saved_results(tmp_path) == work.results
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "<img src=x" not in page
    assert "&lt;img src=x" in page
    assert "{{7*7}}" in page
    assert {path.name for path in tmp_path.iterdir()} == {"batch.csv", "batch_bolls.csv", "index.html", *NAMES}
    assert not [path for name in NAMES for path in (tmp_path / name).iterdir()]


def test_case_44_relative_names_that_look_like_options_reach_the_run_as_names(tmp_path: Path) -> None:
    for name in ("--help", "new\nline"):
        (tmp_path / name).mkdir()
    command = [sys.executable, "-m", "cotton3dg.cli", "batch", ".", "--jobs", "1", "--no-report"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 8, done.stderr
    assert [row["reason"].split(" (")[0] for row in rows_of(tmp_path)] == ["no video", "no video"]


def race(root: Path, rounds: int, start: Any, answers: Any) -> None:
    """Try for the lock at the same moment as another process; whoever has it must be alone."""
    for _ in range(rounds):
        start.wait(60)
        try:
            with Workspace(root).locked():
                os.close(os.open(root / "inside", os.O_CREAT | os.O_EXCL))
                (root / "inside").unlink()
            answers.put("in")
        except EnvironmentUnusable:
            answers.put("turned away")
        except FileExistsError:
            answers.put("not alone")


def test_case_52_in_a_hundred_races_whoever_is_in_is_alone(tmp_path: Path) -> None:
    context = multiprocessing.get_context("fork")
    start, answers = context.Barrier(2), context.Queue()
    racers = [context.Process(target=race, args=(tmp_path, 100, start, answers)) for _ in range(2)]
    for racer in racers:
        racer.start()
    found = [answers.get(timeout=60) for _ in range(200)]
    for racer in racers:
        racer.join(30)
    assert set(found) <= {"in", "turned away"}
    assert found.count("in") >= 100


def test_case_52_of_two_runs_of_one_plant_one_is_turned_away_or_waits(tmp_path: Path) -> None:
    (tmp_path / "video.mp4").write_text("no film")
    command = [sys.executable, "-m", "cotton3dg.cli", "run", str(tmp_path), "--no-report"]
    with Workspace(tmp_path).locked():
        away = subprocess.run(command, capture_output=True, text=True, check=False)
        waiting = subprocess.Popen([*command, "--wait"], stderr=subprocess.PIPE, text=True)
        assert away.returncode == 3
        holder = f"another cotton3dg (process {os.getpid()} on {os.uname().nodename}) is working in this folder; "
        assert f"{holder}wait for it (`cotton3dg run --wait`), or stop it" in away.stderr
        assert waiting.poll() is None
    _, said = waiting.communicate(timeout=60)
    assert waiting.returncode == 4, said
    assert "not a video that can be read" in said
