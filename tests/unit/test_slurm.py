# SPDX-License-Identifier: Apache-2.0
"""Jobs of a cluster, run by submitit's local executor. `make slurm-test` runs them on a real Slurm."""

import csv
import json
import os
import pickle
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from scenes.stand_in_runs import make_plant, stand_in_command, table, until

from cotton3dg import slurm
from cotton3dg.batch import TABLE, Batch, Result, find_plants
from cotton3dg.core.runs import State
from cotton3dg.errors import BadUsage, EnvironmentUnusable
from cotton3dg.staleness import StageState


@pytest.fixture
def stand_in(tmp_path):
    return stand_in_command(tmp_path)


@pytest.fixture
def queue(monkeypatch):
    """What squeue tells: lines of job and state."""
    lines = []
    monkeypatch.setattr(slurm, "_output_of", lambda *command: "\n".join(lines))
    return lines


@pytest.fixture(autouse=True)
def finished(monkeypatch):
    """A plant is done when the stand-in has written its table."""

    def states(workspace, options):
        there = workspace.traits_csv.is_file()
        return [StageState("traits", State.DONE if there else State.STALE, "" if there else "no result", None)]

    monkeypatch.setattr(slurm, "plant_status", states)


def batch_of(field, stand_in=slurm.RUN, **options):
    return Batch(field, ["--preset", "draft"], tell=lambda line: None, command=stand_in, **options)


class Counting:
    """An executor that counts what it is given and runs nothing."""

    def __init__(self):
        self.parts = []

    def map_array(self, work, names):
        self.parts.append(list(names))
        return [SimpleNamespace(job_id=f"{len(self.parts)}_{k}") for k in range(len(names))]


def test_plants_run_as_jobs_and_the_table_tells_what_became_of_them(tmp_path, stand_in, queue):
    submitit = pytest.importorskip("submitit")
    field = tmp_path / "field"
    make_plant(field, "east/good")
    make_plant(field, "bad", "fail no video; film it")
    make_plant(field, "dead", "die")
    make_plant(field, "flaky", "flaky")
    executor = submitit.LocalExecutor(field / slurm.JOBS_FOLDER / "%j")
    executor.update_parameters(timeout_min=5)
    work = batch_of(field, stand_in, retries=1)
    submitted = slurm.submit(work, find_plants(field), executor, 3)
    assert submitted.keys() == {"bad", "dead", "east/good", "flaky"}
    until(lambda: all((field / name / slurm.OUTCOME).is_file() for name in submitted))
    results = slurm.status(batch_of(field), find_plants(field))
    assert [(r.folder, r.state, r.exit_code) for r in results] == [
        ("bad", "failed", 4), ("dead", "failed", -9), ("east/good", "done", 0), ("flaky", "done", 0)
    ]  # fmt: skip
    rows = table(field)
    assert rows[0]["reason"] == "no video; film it"
    assert rows[2]["boll_count"] == "7"
    assert (field / "bad" / slurm.LOG).read_text() == "frames: starts\nbad: no video; film it\n"
    assert (field / "flaky" / "tries").read_text() == (field / "dead" / "tries").read_text() == "2"
    assert (field / "east/good" / "arguments").read_text() == "--wait --preset draft"


def test_arrays_are_split_and_no_plant_is_in_two_jobs(tmp_path, queue):
    field = tmp_path / "field"
    plants = [make_plant(field, f"p{k}") for k in range(7)]
    executor = Counting()
    slurm.submit(batch_of(field), plants[:5], executor, 3)
    assert executor.parts == [["p0", "p1", "p2"], ["p3", "p4"]]
    queue += ["1_1 RUNNING", "2_0 PENDING", "9_9 RUNNING"]
    again = slurm.submit(batch_of(field), plants, executor, 3)
    assert list(again) == ["p0", "p2", "p4", "p5", "p6"]
    jobs = json.loads((field / slurm.JOBS_FOLDER / "jobs.json").read_text())
    assert (jobs["p1"], jobs["p3"], jobs["p0"], jobs["p6"]) == ("1_1", "2_0", "3_0", "4_1")


def test_waiting_running_and_lost_jobs_are_told(tmp_path, queue):
    field = tmp_path / "field"
    plants = [make_plant(field, name) for name in ("a", "b", "c", "d", "e")]
    slurm.submit(batch_of(field), plants[:4], Counting(), 10)
    queue += ["1_0 PENDING", "1_1 RUNNING"]
    (plants[1] / "records").mkdir()
    old = {"folder": "b", "state": "done", "exit_code": 0, "reason": ""}
    (plants[1] / slurm.OUTCOME).write_text(json.dumps(old))  # of an earlier job
    (plants[3] / "records").mkdir()
    (plants[3] / slurm.OUTCOME).write_text("{half")
    results = {result.folder: result for result in slurm.status(batch_of(field), plants)}
    assert {name: (result.state, result.reason.split(";")[0]) for name, result in results.items()} == {
        "a": ("waiting", "job 1_0 is pending"),
        "b": ("waiting", "job 1_1 is running"),
        "c": ("failed", "job 1_2 ended without a word"),
        "d": ("failed", "job 1_3 ended without a word"),
        "e": ("waiting", "not submitted"),
    }


def test_status_without_jobs_is_that_of_the_saved_table(tmp_path, stand_in):
    field = tmp_path / "field"
    make_plant(field, "a")
    never_run = Result("a", State.STALE, None, "traits: no result")
    assert slurm.status(batch_of(field), find_plants(field)) == [never_run]
    assert not (field / TABLE).exists()
    done = batch_of(field, stand_in).run(find_plants(field))
    before = (field / TABLE).read_bytes()
    assert slurm.status(batch_of(field), find_plants(field)) == done
    (field / "a" / "traits" / "traits.csv").unlink()
    assert slurm.status(batch_of(field), find_plants(field)) == [never_run]
    assert (field / TABLE).read_bytes() == before


def test_at_the_time_limit_the_run_is_ended_and_the_same_job_goes_on(tmp_path, stand_in):
    pytest.importorskip("submitit")
    field = tmp_path / "field"
    plant = make_plant(field, "a", "sleep 60")
    job = slurm.PlantJob(field, ["--preset", "draft"], 0, stand_in)
    working = threading.Thread(target=job, args=("a",))
    working.start()
    until((plant / "awake").exists)
    began = time.monotonic()
    queued = job.checkpoint("a")
    working.join(30)
    assert time.monotonic() - began < 30
    (plant / "behaviour").write_text("ok")
    assert queued.args == ("a",)
    again = pickle.loads(pickle.dumps(queued.function))
    again("a")
    saved = json.loads((plant / slurm.OUTCOME).read_text())
    assert saved == {"folder": "a", "state": "done", "exit_code": 0, "reason": ""}
    with (plant / "traits" / "traits.csv").open(encoding="utf-8-sig", newline="") as file:
        assert len(list(csv.DictReader(file))) == 1


def test_settings_and_what_is_missing(tmp_path, monkeypatch):
    submitit = pytest.importorskip("submitit")
    monkeypatch.setattr(slurm.shutil, "which", lambda name: None)
    with pytest.raises(EnvironmentUnusable, match="sbatch is not on the PATH"):
        slurm.slurm_executor(tmp_path, [])
    monkeypatch.setattr(slurm.shutil, "which", lambda name: f"/usr/bin/{name}")
    for settings, told in ((["partition"], "KEY=VALUE"), (["colour=red"], "colour")):
        with pytest.raises(BadUsage, match=told):
            slurm.slurm_executor(tmp_path, settings)
    executor = slurm.slurm_executor(tmp_path, ["partition=short", "mem=1500M", "time=30", "cpus-per-task=3"])
    assert isinstance(executor, submitit.SlurmExecutor)
    script = executor._make_submission_file_text("work", "1")
    for line in ("partition=short", "mem=1500M", "time=30", "cpus-per-task=3", "requeue", "signal=USR2@90"):
        assert f"#SBATCH --{line}\n" in script
    assert "srun" in script and "--cpus-per-task=3" in script.split("srun")[1]
    monkeypatch.setitem(sys.modules, "submitit", None)
    with pytest.raises(EnvironmentUnusable, match=r"cotton3dg\[slurm\]"):
        slurm.slurm_executor(tmp_path, [])


def test_the_size_of_arrays_is_asked_for(monkeypatch):
    monkeypatch.setattr(slurm, "_output_of", lambda *command: "MailProg = x\nMaxArraySize            = 51\n")
    assert slurm.max_array_size() == 51
    monkeypatch.setattr(slurm, "_output_of", lambda *command: "")
    assert slurm.max_array_size() == 1001


def test_a_slurm_that_does_not_answer_is_told():
    with pytest.raises(EnvironmentUnusable, match=r"false fails .*; start it where"):
        slurm._output_of("false")


def test_the_example_of_a_plain_array_runs_each_plant_once(tmp_path):
    script = Path(__file__).parents[2] / "examples" / "slurm_array.sh"
    tools = tmp_path / "bin"
    tools.mkdir()
    sbatch = 'for n in 0 1 2; do echo "$@" >> sbatch_said; SLURM_ARRAY_TASK_ID=$n bash "$3" "$4"; done'
    for name, text in (("sbatch", sbatch), ("cotton3dg", 'echo "$@"')):
        (tools / name).write_text(f"#!/bin/bash\n{text}\n")
        (tools / name).chmod(0o755)
    plants = [make_plant(tmp_path / "field", name) for name in ("a", "b c", "$(touch x)")]
    environment = os.environ | {"PATH": f"{tools}:{os.environ['PATH']}"}
    environment.pop("SLURM_ARRAY_TASK_ID", None)
    subprocess.run(["bash", str(script), "field", "--partition=short"], cwd=tmp_path, env=environment, check=True)
    assert (tmp_path / "sbatch_said").read_text().startswith(f"--array=0-2 --partition=short {script} ")
    for plant in plants:
        assert (plant / "slurm.log").read_text() == f"run {plant} --wait\n"
    assert not (tmp_path / "x").exists()
