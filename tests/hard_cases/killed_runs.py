# SPDX-License-Identifier: Apache-2.0
"""Runs of a small made plant that are looked at in every moment at which they could die, or that are killed.

    python tests/hard_cases/killed_runs.py look FOLDER                 at every write boundary of every stage
    python tests/hard_cases/killed_runs.py kill FOLDER --kills 100     at random times, over one accumulating folder

What a killed process leaves is what is on the disk at that moment, for nothing of it runs any more; so a look from
inside, at every call that changes the disk, sees what a kill at that call would leave.
"""

from __future__ import annotations

import argparse
import csv
import json
import random
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from cotton3dg import pipeline
from cotton3dg.io.video import ffmpeg_binary
from cotton3dg.workspace import Workspace

sys.path.append(str(Path(__file__).parents[1]))

SMALL = {
    "frames.count": 28, "sfm.max_features": 1500, "train.steps": 60, "train.max_side": 200,
    "train.max_gaussians": 4000, "masks.views": 6,
}  # fmt: skip
N_FILMED, FPS = 50, 24
CHANGES = ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.truncate")
"""Python's audit events of calls that change the disk; of "open" only those for writing."""


def film_room(path: Path) -> None:
    """One turn around the box of room_scene, as a video."""
    from scenes.room_scene import HEIGHT, WIDTH, render, textures

    faces = textures()
    frames = [render(faces, 2 * np.pi * number / N_FILMED) for number in range(N_FILMED)]
    command = [ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-r", str(FPS)]
    command += ["-s", f"{WIDTH}x{HEIGHT}", "-i", "pipe:0", "-pix_fmt", "yuv420p", "-crf", "12", "-g", "8"]
    subprocess.run([*command, str(path)], input=b"".join(frame.tobytes() for frame in frames), check=True)


def small_options(workspace: Workspace) -> dict[str, Any]:
    overrides: dict[str, dict[str, Any]] = {}
    for key, value in SMALL.items():
        stage, name = key.split(".")
        overrides.setdefault(stage, {})[name] = value
    return pipeline.stage_options(workspace, overrides=overrides)


def run_command(plant: Path, *arguments: str) -> list[str]:
    options = [word for key, value in SMALL.items() for word in ("--set", f"{key}={value}")]
    return [sys.executable, "-m", "cotton3dg.cli", "run", str(plant), "--no-report", *options, *arguments]


def results(workspace: Workspace) -> dict[str, Any]:
    """Everything that the stages wrote, without seconds."""
    found: dict[str, Any] = {}
    for name, sha256 in workspace.hashes(*(workspace.folder(stage) for stage in pipeline.STAGES)).items():
        path = workspace.root / name
        if path.suffix == ".json":
            found[name] = _timeless(json.loads(path.read_text()))
        elif path.suffix == ".csv":
            with path.open(newline="") as file:
                found[name] = [_timeless(row) for row in csv.DictReader(file)]
        else:
            found[name] = sha256
    return found


def _timeless(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _timeless(item) for key, item in value.items() if "seconds" not in key}
    return [_timeless(item) for item in value] if isinstance(value, list) else value


def assert_whole(workspace: Workspace) -> dict[str, dict[str, str]]:
    """Every record tells what is in its stage's folder; returns that of all stages."""
    found = {stage: workspace.hashes(workspace.folder(stage)) for stage in pipeline.STAGES}
    for stage, files in found.items():
        record = workspace.read_record(stage)
        assert record is None or not record.is_ok or record.outputs == files, stage
    return found


@contextmanager
def looking(workspace: Workspace, states: list[tuple[str, dict[str, dict[str, str]]]]) -> Iterator[None]:
    """Append the event and the results to `states` before each call that changes the plant's folder."""
    root, active = str(workspace.root), [True]

    def look(event: str, arguments: tuple[Any, ...]) -> None:
        if not active[0] or event not in CHANGES or not str(arguments[0]).startswith(root):
            return
        if event == "open" and not set(arguments[1] or "r") & set("wax+"):
            return
        active[0] = False  # looking opens files, too
        states.append((event, assert_whole(workspace)))
        active[0] = True

    sys.addaudithook(look)
    try:
        yield
    finally:
        active[0] = False


def look_everywhere(folder: Path) -> None:
    """Run all stages on a new plant, then again over the old results; at any moment they are old, new or not there."""
    folder.mkdir(parents=True)
    film_room(folder / "video.mp4")
    workspace = Workspace(folder)
    options, n = small_options(workspace), Counter[str]()
    for stage in pipeline.STAGES:
        old = workspace.hashes(workspace.folder(stage))
        for _ in ("new", "again"):
            states: list[tuple[str, dict[str, dict[str, str]]]] = []
            with looking(workspace, states):
                pipeline.run(workspace, options, (stage,), force=True)
            new = workspace.hashes(workspace.folder(stage))
            for _, found in states:
                assert found[stage] in (old, new, {}), stage
            n[stage] += len(states)
            old = new
    print(f"{n.total()} boundaries: " + ", ".join(f"{stage} {count}" for stage, count in n.items()))


def kill_at_random(folder: Path, n_kills: int, seed: int, undisturbed: Path) -> None:
    """Kill runs over one folder, in a stage drawn for each, for their times are very unlike; after each the records are
    right, at the end the results are those of `undisturbed`.

    Args:
        undisturbed: a finished plant with the same video.
    """
    folder.mkdir(parents=True)
    shutil.copyfile(undisturbed / "video.mp4", folder / "video.mp4")
    workspace, chance = Workspace(folder), random.Random(seed)
    records = [record for record in map(Workspace(undisturbed).read_record, pipeline.STAGES) if record]
    seconds = {record.stage: record.seconds for record in records}
    n, died_in = 0, Counter[str]()
    while n < n_kills:
        victim = chance.choice(pipeline.STAGES)
        plan = pipeline.plan(workspace, small_options(workspace), pipeline.STAGES)
        ahead = [step.stage for step in plan if step.reason]
        # What is up to date would not start.
        arguments = [] if victim in ahead else ["--force", "--from", victim]
        process = subprocess.Popen(
            run_command(folder, *arguments), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        assert process.stderr is not None
        said = []
        for line in process.stderr:
            said.append(line)
            if line.startswith(f"{victim}: starts"):
                break
        time.sleep(chance.uniform(0, 1.2 * seconds[victim]))
        process.kill()
        said += process.stderr.readlines()
        process.stderr.close()
        assert process.wait() in (0, -9), said
        assert_whole(workspace)
        if process.returncode == -9:  # and not done before it could be killed
            n += 1
            died_in[[line.split(":")[0] for line in said if ": starts" in line][-1]] += 1
    subprocess.run(run_command(folder), capture_output=True, check=True)
    assert results(workspace) == results(Workspace(undisturbed))
    assert not [path for path in folder.rglob(".*") if path.name.endswith((".partial", ".old"))]
    print(f"{n} kills: " + ", ".join(f"{stage} {count}" for stage, count in died_in.most_common()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("how", choices=("look", "kill"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    wanted = parser.parse_args()
    if wanted.how == "look":
        look_everywhere(wanted.folder)
    else:
        # Of one name, for that is in the tables.
        undisturbed, killed = (wanted.folder / how / "plant" for how in ("undisturbed", "killed"))
        look_everywhere(undisturbed)
        kill_at_random(killed, wanted.kills, wanted.seed, undisturbed)
