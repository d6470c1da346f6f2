# SPDX-License-Identifier: Apache-2.0
"""File systems that lack what others have: locks, dates, permissions, hard links, folders that can be synchronised."""

from __future__ import annotations

import errno
import fcntl
import multiprocessing
import os
import platform
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from scenes.small_stages import filmed_plant, replace_stages

from cotton3dg import pipeline
from cotton3dg.commands.import_ import _take
from cotton3dg.core.runs import StageOutcome
from cotton3dg.errors import EnvironmentUnusable, OutOfResources
from cotton3dg.io import lock
from cotton3dg.io.saving import copy, explain_disk_errors, fsync, link, replacing, write_text_atomically
from cotton3dg.plants import plant_at
from cotton3dg.stage import Cost, Stage
from cotton3dg.workspace import Workspace


def refusing(number: int) -> Callable[..., Any]:
    def refuse(*_: Any, **__: Any) -> None:
        raise OSError(number, os.strerror(number))

    return refuse


def lack(monkeypatch: pytest.MonkeyPatch, what: str, number: int) -> None:
    if what != "fsync":
        monkeypatch.setattr(fcntl if what == "flock" else os, what, refusing(number))
        return
    honest = os.fsync

    def of_files_only(handle: int) -> None:
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            refusing(number)()
        honest(handle)

    monkeypatch.setattr(os, "fsync", of_files_only)


LACKING = [
    ("flock", errno.ENOSYS), ("flock", errno.ENOLCK), ("flock", errno.EOPNOTSUPP), ("fsync", errno.EINVAL),
    ("fsync", errno.EPERM), ("link", errno.EPERM), ("link", errno.EMLINK), ("chmod", errno.EPERM),
    ("utime", errno.EPERM), ("utime", errno.ENOSYS),
]  # fmt: skip
every_lack = pytest.mark.parametrize(("what", "number"), LACKING)


@every_lack
def test_a_run_saves_each_stage_and_its_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str, number: int
) -> None:
    def make(stage: str) -> Stage:
        def run(workspace: Workspace, options: Any, progress: Any) -> StageOutcome:
            with workspace.writing(stage) as folder:
                (folder / "out.txt").write_text(stage)
            return StageOutcome({})

        return Stage(stage, 1, lambda workspace: [workspace.capture()], run, lambda work: Cost(0.0))

    replace_stages(monkeypatch, make)
    workspace = filmed_plant(tmp_path)
    lack(monkeypatch, what, number)
    for _ in range(2):
        pipeline.run(workspace, pipeline.stage_options(workspace), force=True)
        records = [workspace.read_record(stage) for stage in pipeline.STAGES]
        assert {record.status if record else "lost" for record in records} == {"ok"}
    assert not list(workspace.root.glob(".lock.*"))


@every_lack
def test_videos_are_taken_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str, number: int) -> None:
    (tmp_path / "DCIM").mkdir()
    film = tmp_path / "DCIM" / "walk.mp4"
    film.write_bytes(b"film")
    lack(monkeypatch, what, number)
    for how in ("copy", "move"):
        _take(film, tmp_path / f"{how}.mp4", how)
        assert (tmp_path / f"{how}.mp4").read_bytes() == b"film"
    assert (plant_at(film, make=True).root / "walk.mp4").read_bytes() == b"film"


@every_lack
def test_results_are_shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str, number: int) -> None:
    (tmp_path / "a" / "deep").mkdir(parents=True)
    (tmp_path / "a" / "deep" / "x.txt").write_text("x")
    (tmp_path / "a" / "nothing").symlink_to("nowhere")
    (tmp_path / "a" / "round").symlink_to(tmp_path / "a")
    os.mkfifo(tmp_path / "a" / "pipe")
    lack(monkeypatch, what, number)
    link(tmp_path / "a", tmp_path / "b")
    assert [path.name for path in tmp_path.joinpath("b").rglob("*")] == ["deep", "x.txt"]


def test_a_copy_keeps_its_dates_where_there_are_dates(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("a")
    os.utime(tmp_path / "a", (1e9, 1e9))
    copy(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "b").stat().st_mtime == 1e9


@pytest.mark.parametrize("number", [errno.EIO, errno.ENOSPC, errno.EDQUOT])
def test_a_disk_that_fails_is_never_taken_for_one_that_lacks_something(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    (tmp_path / "a").write_text("old")
    monkeypatch.setattr(os, "fsync", refusing(number))
    with pytest.raises(OSError, match=os.strerror(number)):
        fsync(tmp_path / "a")
    with pytest.raises((EnvironmentUnusable, OutOfResources), match="; "), explain_disk_errors(tmp_path):
        write_text_atomically(tmp_path / "a", "new")
    assert (tmp_path / "a").read_text() == "old"


def hold_without_locks(root: Path, holding: Any, release: Any) -> None:
    fcntl.flock = refusing(errno.ENOLCK)
    with Workspace(root).locked():
        holding.set()
        release.wait(30)


def test_without_locks_a_second_process_is_turned_away_and_a_dead_one_holds_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = multiprocessing.get_context("spawn")
    holding, release = context.Event(), context.Event()
    holder = context.Process(target=hold_without_locks, args=(tmp_path, holding, release))
    holder.start()
    lack(monkeypatch, "flock", errno.ENOLCK)
    left = f".lock.{holder.pid}.{platform.node()}"
    try:
        assert holding.wait(60)
        with (
            pytest.raises(EnvironmentUnusable, match=rf"process {holder.pid} on .*delete {left}"),
            Workspace(tmp_path).locked(),
        ):
            pass
    finally:
        holder.kill()
        holder.join()
    assert sorted(path.name for path in tmp_path.iterdir()) == [".lock", left]
    with Workspace(tmp_path).locked(wait=True):
        assert not (tmp_path / left).exists()
    assert [path.name for path in tmp_path.iterdir()] == [".lock"]


def test_without_locks_another_host_keeps_its_hold_and_who_waits_gets_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lack(monkeypatch, "flock", errno.ENOSYS)
    other = tmp_path / ".lock.1.elsewhere"
    other.touch()
    with (
        pytest.raises(EnvironmentUnusable, match=r"process 1 on elsewhere.*delete \.lock\.1\.elsewhere"),
        Workspace(tmp_path).locked(),
    ):
        pass
    slept: list[float] = []

    def until_it_ends(seconds: float) -> None:
        slept.append(seconds)
        other.unlink()

    monkeypatch.setattr(lock.time, "sleep", until_it_ends)
    with Workspace(tmp_path).locked(wait=True):
        assert len(slept) == 1


@pytest.mark.parametrize("name", ["x" * 251 + ".mp4", "ü" * 125 + ".mp4", "x" * 255])
def test_the_longest_names_have_room_for_a_temporary_one(tmp_path: Path, name: str) -> None:
    assert len(os.fsencode(name)) >= 254
    with replacing(tmp_path / name) as partial:
        partial.write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    with Workspace(tmp_path).writing(f"render/{name}") as folder:
        (folder / "x").touch()
    assert (tmp_path / "render" / name / "x").exists()
