# SPDX-License-Identifier: Apache-2.0
"""Fifty small plants in one batch, five of them broken, undisturbed and then killed again and again.

    python tests/stress/fifty_plants.py /tmp/fifty        (`make batch-test`; some 25 CPU-minutes)

The 45 sound plants are a few simulated videos, each with noise of its own, so that no two are alike. The batch that is
killed with SIGKILL, every other time together with the plants it is running, and started again has to end with the
tables of the undisturbed one, byte for byte but for the seconds.
"""

from __future__ import annotations

import argparse
import csv
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

from cotton3dg.commands.simulate import simulate
from cotton3dg.errors import SOME_FAILED
from cotton3dg.io.video import ffmpeg_binary
from cotton3dg.options import resolve

SMALL = {
    "frames.count": 24, "sfm.max_features": 768, "sfm.overlap": 6, "train.steps": 150, "train.max_side": 240,
    "train.max_gaussians": 6000, "masks.views": 10,
}  # fmt: skip
FILM = {"frames": 62, "width": 480, "height": 270, "supersampling": 1, "mask_interval": 62, "bolls": 6}
BROKEN = {
    "broken_empty": "no video",
    "broken_options": "frames.cuont",
    "broken_text": "not a video that can be read",
    "broken_truncated": "is damaged",
    "broken_still": "stands still",
}
"""Folders with the words that their failures have to have."""


def filmed(target: Path, source: Path, *arguments: str) -> None:
    command = [ffmpeg_binary(), "-v", "error", "-nostdin", "-i", str(source), *arguments, "-crf", "14", "-an"]
    subprocess.run([*command, str(target)], check=True)


def make_plants(folder: Path, n_sound: int, n_videos: int) -> None:
    """`n_sound` plants made of `n_videos` simulated ones, and the broken ones."""
    videos = []
    for seed in range(1, n_videos + 1):
        video = folder.parent / f"{folder.name}_videos" / f"{seed}"
        if not (video / "video.mp4").exists():
            simulate(video, resolve("simulate", FILM | {"seed": seed}))
        videos.append(video / "video.mp4")
    for number in range(n_sound):
        plant = folder / f"plant_{number + 1:02d}"
        plant.mkdir(parents=True)
        noise = f"noise=all_seed={number + 1}:alls=4:allf=t+u"
        filmed(plant / "walk.mp4", videos[number % n_videos], "-vf", noise)
    for name in BROKEN:
        (folder / name).mkdir(parents=True)
    shutil.copyfile(videos[0], folder / "broken_options" / "walk.mp4")
    (folder / "broken_options" / "cotton3dg.toml").write_text("[frames]\ncuont = 30\n")
    (folder / "broken_text" / "walk.mp4").write_bytes(b"a letter, not a film" * 1000)
    whole = folder / "broken_truncated" / "walk.mp4"
    filmed(whole, videos[0], "-movflags", "+faststart")
    whole.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    filmed(folder / "broken_still" / "walk.mp4", videos[0], "-vf", "select=eq(n\\,0),loop=90:1:0,setpts=N/30/TB")


def batch_command(folder: Path, jobs: int) -> list[str]:
    options = [word for key, value in SMALL.items() for word in ("--set", f"{key}={value}")]
    return [sys.executable, "-m", "cotton3dg.cli", "batch", str(folder), "--jobs", str(jobs), "--no-report", *options]


def children_of(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()] + [
        child
        for thread in Path(f"/proc/{pid}/task").iterdir()
        if thread.name != str(pid)
        for child in map(int, (thread / "children").read_text().split())
    ]


def kill(process: subprocess.Popen[bytes], with_plants: bool) -> None:
    plants = children_of(process.pid) if with_plants else []
    process.kill()
    process.wait()
    for pid in plants:
        with suppress(ProcessLookupError):  # it had just ended
            os.kill(pid, signal.SIGKILL)


def finish(folder: Path, jobs: int) -> float:
    """Run the batch to its end; wall seconds."""
    began = time.monotonic()
    with (folder.parent / f"{folder.name}.log").open("ab") as log:
        code = subprocess.run(batch_command(folder, jobs), stdout=log, stderr=log, check=False).returncode
    assert code == SOME_FAILED, code
    return time.monotonic() - began


def rows(table: Path) -> list[dict[str, str]]:
    with table.open(newline="") as file:
        return list(csv.DictReader(file))


def without_seconds(table: Path) -> list[list[str]]:
    with table.open(newline="") as file:
        lines = list(csv.reader(file))
    timed = {k for k, name in enumerate(lines[0]) if name == "seconds"}
    return [[cell for k, cell in enumerate(line) if k not in timed] for line in lines]


def check(folder: Path, n_sound: int) -> None:
    table = rows(folder / "batch.csv")
    assert [row["state"] for row in table] == ["failed"] * len(BROKEN) + ["done"] * n_sound
    for row in table[: len(BROKEN)]:
        assert row["reason"] and BROKEN[row["folder"]] in row["reason"], row
        print(f"  {row['folder']}: exit code {row['exit_code']}: {row['reason']}")
    assert all(row["boll_count"] for row in table[len(BROKEN) :])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--plants", type=int, default=45, help="sound ones")
    parser.add_argument("--videos", type=int, default=5, help="simulated videos that they are made of")
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of the times of the kills")
    wanted = parser.parse_args()
    wanted.folder.mkdir(parents=True)
    calm, killed = wanted.folder / "calm", wanted.folder / "killed"
    make_plants(calm, wanted.plants, wanted.videos)
    shutil.copytree(calm, killed)

    whole_s = finish(calm, wanted.jobs)
    print(f"undisturbed: {wanted.plants + len(BROKEN)} plants in {whole_s:.0f} s", flush=True)
    check(calm, wanted.plants)

    chance = random.Random(wanted.seed)
    for number in range(wanted.kills):
        until_s = chance.uniform(5, whole_s / (wanted.kills + 1))
        process = subprocess.Popen(
            batch_command(killed, wanted.jobs), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        time.sleep(until_s)
        assert process.poll() is None, "the batch ended before it could be killed; use fewer --kills"
        kill(process, with_plants=number % 2 == 0)
        done = sum(row["state"] == "done" for row in rows(killed / "batch.csv"))
        print(f"killed after {until_s:.0f} s with {done} plants done", flush=True)
    finish(killed, wanted.jobs)
    check(killed, wanted.plants)
    for table in ("batch.csv", "batch_bolls.csv"):
        assert without_seconds(killed / table) == without_seconds(calm / table), f"{table} differs"
        print(f"{table}: {len(rows(calm / table))} rows, the same bytes but for the seconds")


if __name__ == "__main__":
    main()
