# SPDX-License-Identifier: Apache-2.0
"""Hard cases 49 and 50: a process that dies, or a disk that fills up, at any step of saving a result."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cotton3dg.errors import OutOfResources
from cotton3dg.io.saving import explain_disk_errors, replacing
from cotton3dg.schemas.record import Record
from cotton3dg.workspace import Workspace

GROWING = [(os, "fsync"), (Path, "rename"), (Path, "replace"), (Path, "mkdir"), (Path, "touch"), (Path, "write_text")]
"""What can find the disk full."""
BOUNDARIES = [*GROWING, (Path, "unlink"), (shutil, "rmtree")]
OLD, NEW = {"a.txt": "old", "b.txt": "old"}, {"a.txt": "new", "c.txt": "new"}


def save(workspace: Workspace, content: dict[str, str]) -> None:
    """What the pipeline does for a stage: its folder, then its record; and a single file."""
    with workspace.writing("scale") as folder:
        for name, text in content.items():
            (folder / name).write_text(text)
    workspace.write_record(Record("scale", outputs=workspace.hashes(workspace.folder("scale"))))
    with explain_disk_errors(workspace.root), replacing(workspace.root / "single.txt") as path:
        path.write_text(content["a.txt"])


@contextmanager
def counted(
    before: Callable[[int], None], after: Callable[[int], None], boundaries: list[tuple[Any, str]] = BOUNDARIES
) -> Iterator[list[int]]:
    """Calls `before` and `after` each boundary with its number."""
    honest = {(owner, name): getattr(owner, name) for owner, name in boundaries}
    calls = [0]

    def watched(act: Any) -> Any:
        def called(*arguments: Any, **named: Any) -> Any:
            calls[0] += 1
            number = calls[0]
            before(number)
            result = act(*arguments, **named)
            after(number)
            return result

        return called

    try:
        for (owner, name), act in honest.items():
            setattr(owner, name, watched(act))
        yield calls
    finally:
        for (owner, name), act in honest.items():
            setattr(owner, name, act)


def saved_twice(folder: Path, boundaries: list[tuple[Any, str]]) -> tuple[Workspace, int]:
    """A workspace with an old result, and the number of boundaries that saving a new one passes."""
    folder.mkdir()
    workspace = Workspace(folder)
    save(workspace, OLD)
    with counted(lambda _: None, lambda _: None, boundaries) as calls:
        save(workspace, NEW)
    save(workspace, OLD)
    return workspace, calls[0]


def content_of(workspace: Workspace) -> dict[str, str] | None:
    folder = workspace.folder("scale")
    return {path.name: path.read_text() for path in folder.glob("*.txt")} if folder.exists() else None


def assert_whole(workspace: Workspace) -> None:
    """Old or new; whatever has a record is what the record says, and saving again works and leaves nothing behind."""
    record = workspace.read_record("scale")
    assert content_of(workspace) in ((OLD, NEW) if record else (OLD, NEW, None))
    if record:
        assert record.outputs == workspace.hashes(workspace.folder("scale"))
    assert (workspace.root / "single.txt").read_text() in ("old", "new")
    save(workspace, OLD)
    assert content_of(workspace) == OLD
    left = {path.name for path in workspace.root.iterdir()}
    assert left == {"scale", "records", "single.txt"} | (left & {".single.txt.partial"})
    shutil.rmtree(workspace.root / ".single.txt.partial", ignore_errors=True)


@pytest.mark.parametrize("when", ["before", "after"])
def test_case_49_killed_at_any_boundary_the_result_is_the_old_or_the_new_one(tmp_path: Path, when: str) -> None:
    workspace, n = saved_twice(tmp_path / "plant", BOUNDARIES)
    assert n > 15
    for at in range(1, n + 1):

        def die(number: int, at: int = at) -> None:
            if number == at:
                os._exit(9)

        child = os.fork()
        if child == 0:
            with counted(*((die, lambda _: None) if when == "before" else (lambda _: None, die))):
                save(workspace, NEW)
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
        assert_whole(workspace)


def test_case_50_a_disk_that_is_full_at_any_boundary_is_told_and_costs_nothing_old(tmp_path: Path) -> None:
    workspace, n = saved_twice(tmp_path / "plant", GROWING)
    told = 0
    for at in range(1, n + 1):

        def full(number: int, at: int = at) -> None:
            if number == at:
                raise OSError(errno.ENOSPC, "No space left on device")

        with counted(full, lambda _: None, GROWING):
            try:
                save(workspace, NEW)
            except OutOfResources as error:
                assert "is full; free some space" in str(error)
                told += 1
        assert_whole(workspace)
    assert told == n
