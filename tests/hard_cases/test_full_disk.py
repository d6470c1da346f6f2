# SPDX-License-Identifier: Apache-2.0
"""Hard case 50 on a disk that really is full: a small tmpfs, filled up but for a few kilobytes."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from killed_runs import assert_whole, film_room, small_options

from cotton3dg import pipeline, resource_checks
from cotton3dg.errors import OutOfResources
from cotton3dg.workspace import Workspace

DISK_MIB = 24


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "video.mp4"
    film_room(path)
    return path


@pytest.fixture
def workspace(tmp_path: Path, film: Path) -> Iterator[Workspace]:
    """A plant on a disk of its own."""
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK_MIB}m", "tmpfs", str(tmp_path)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("this user may not mount a tmpfs")
    try:
        (tmp_path / "plant").mkdir()
        shutil.copyfile(film, tmp_path / "plant" / "video.mp4")
        yield Workspace(tmp_path / "plant")
    finally:
        subprocess.run(["umount", "--lazy", str(tmp_path)], check=True)


def filled(workspace: Workspace, free_kib: int) -> Path:
    """A file that leaves so much of the disk free."""
    ballast = workspace.root.parent / "ballast"
    ballast.unlink(missing_ok=True)
    stat = os.statvfs(workspace.root)
    with ballast.open("wb", buffering=0) as file:
        file.write(bytes(max(0, stat.f_bavail * stat.f_frsize - 1024 * free_kib)))
    return ballast


@pytest.mark.slow
@pytest.mark.parametrize(("stage", "rooms_kib"), [("frames", (0, 400)), ("sfm", (16,))])
def test_case_50_on_a_full_disk_a_stage_ends_with_a_reason_and_the_old_result_stays(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch, stage: str, rooms_kib: tuple[int, ...]
) -> None:
    options = small_options(workspace)
    with pytest.raises(OutOfResources, match=r"frames needs about .* MiB of disk and .* MiB are free"):
        pipeline.run(workspace, options, ("frames",))
    monkeypatch.setattr(resource_checks, "needed_disk_mib", lambda *_: 0)
    pipeline.run(workspace, options, pipeline.selected("frames", stage))
    before = assert_whole(workspace)
    for free_kib in rooms_kib:
        ballast = filled(workspace, free_kib)
        with pytest.raises(OutOfResources, match="is full; free some space") as told:
            pipeline.run(workspace, options, (stage,), force=True)
        assert told.value.exit_code == 7
        ballast.unlink()
        assert workspace.hashes(workspace.folder(stage)) == before[stage]
        assert not [path.name for path in workspace.root.iterdir() if path.name.endswith((".partial", ".old"))]
    pipeline.run(workspace, options, (stage,))
    assert assert_whole(workspace)[stage] == before[stage]


def test_a_full_disk_is_one(workspace: Workspace) -> None:
    """The test above would pass on any disk that only says so."""
    ballast = filled(workspace, 0)
    with pytest.raises(OSError) as told, (workspace.root / "more").open("wb", buffering=0) as file:
        file.write(bytes(8192))
        file.write(bytes(8192))
    assert told.value.errno == errno.ENOSPC
    ballast.unlink()
