# SPDX-License-Identifier: Apache-2.0
"""The plant's folder: inputs, atomic saves, foreign files, the lock."""

import errno
import json
import multiprocessing
import os
import shutil
import stat

import pytest

from cotton3dg.errors import BadInput, EnvironmentUnusable, MissingInput, OutOfResources
from cotton3dg.io import lock
from cotton3dg.io.saving import explain_disk_errors, file_sha256, json_text
from cotton3dg.masks.bolls import SHIPPED_FILE
from cotton3dg.schemas.record import Record
from cotton3dg.workspace import Workspace


@pytest.fixture
def workspace(tmp_path):
    folder = tmp_path / "plant_007"
    folder.mkdir()
    return Workspace(folder)


def test_capture_finds_the_one_video(workspace):
    with pytest.raises(MissingInput, match="no video"):
        workspace.capture()
    (workspace.root / "images").mkdir()
    assert workspace.capture() == workspace.root / "images"
    (workspace.root / "walk.MOV").touch()
    (workspace.root / "._walk.MOV").touch()  # what macOS leaves on a memory card
    assert workspace.capture() == workspace.root / "walk.MOV"
    (workspace.root / "again.mp4").touch()
    with pytest.raises(BadInput, match=r"again\.mp4, walk\.MOV"):
        workspace.capture()


def test_a_path_that_is_no_folder(tmp_path):
    with pytest.raises(MissingInput, match="does not exist"):
        Workspace(tmp_path / "nowhere")
    (tmp_path / "walk.mp4").touch()
    with pytest.raises(MissingInput, match="not a folder"):
        Workspace(tmp_path / "walk.mp4")


def write(workspace, text):
    with workspace.writing("frames") as folder:
        (folder / "a.txt").write_text(text)


def test_a_save_replaces_the_whole_folder(workspace):
    write(workspace, "one")
    (workspace.folder("frames") / "stray.txt").touch()
    write(workspace, "two")
    assert (workspace.folder("frames") / "a.txt").read_text() == "two"
    assert not (workspace.folder("frames") / "stray.txt").exists()


def test_a_failed_save_keeps_the_old_result(workspace):
    write(workspace, "one")
    with pytest.raises(RuntimeError), workspace.writing("frames") as folder:
        (folder / "a.txt").write_text("half")
        raise RuntimeError
    assert (workspace.folder("frames") / "a.txt").read_text() == "one"
    assert [path.name for path in workspace.root.iterdir()] == ["frames"]


@pytest.mark.parametrize("make", ["folder", "file", "link"])
def test_foreign_output_is_never_replaced(workspace, make):
    path = workspace.folder("frames")
    if make == "folder":
        path.mkdir()
        (path / "thesis.txt").write_text("mine")
    elif make == "file":
        path.write_text("mine")
    else:
        path.symlink_to(workspace.root.parent)
    with pytest.raises(BadInput, match="not made by it"):
        write(workspace, "one")
    assert path.is_symlink() or path.is_file() or (path / "thesis.txt").read_text() == "mine"


def test_what_comes_with_the_program_has_the_same_name_wherever_it_is_installed(workspace, tmp_path, monkeypatch):
    (name,) = workspace.hashes(SHIPPED_FILE)
    assert name == "cotton3dg/masks/bolls.onnx"
    moved = tmp_path / "elsewhere" / "cotton3dg"
    (moved / "masks").mkdir(parents=True)
    shutil.copyfile(SHIPPED_FILE, moved / "masks" / "bolls.onnx")
    monkeypatch.setattr("cotton3dg.workspace.PACKAGE", moved.resolve())
    assert workspace.hashes(moved / "masks" / "bolls.onnx") == {name: file_sha256(SHIPPED_FILE)}


def test_hashes_follow_content_only(workspace):
    write(workspace, "one")
    before = workspace.hashes(workspace.folder("frames"))
    os.utime(workspace.folder("frames") / "a.txt", (0, 0))
    assert workspace.hashes(workspace.folder("frames")) == before
    assert list(before) == ["frames/a.txt"]
    write(workspace, "two")
    assert workspace.hashes(workspace.folder("frames")) != before


def test_an_unreadable_record_counts_as_none(workspace):
    workspace.write_record(Record("frames", "ok"))
    assert workspace.read_record("frames") == Record("frames", "ok")
    workspace.record_file("frames").write_text('{"status": "o')
    assert workspace.read_record("frames") is None


def test_json_has_no_nan():
    assert json.loads(json_text({"a": float("nan"), "b": [float("inf"), 1.5]})) == {"a": None, "b": [None, 1.5]}


@pytest.mark.parametrize(
    "number, error",
    [
        (errno.ENOSPC, OutOfResources),
        (errno.EFBIG, OutOfResources),
        (errno.EROFS, EnvironmentUnusable),
        (errno.EIO, EnvironmentUnusable),
        (errno.ENOENT, OSError),
    ],
)
def test_disk_errors_are_explained(workspace, number, error):
    with pytest.raises(error), explain_disk_errors(workspace.root):
        raise OSError(number, os.strerror(number))


def hold(root, holding, release):
    with Workspace(root).locked():
        holding.set()
        release.wait(30)


def test_the_lock_excludes_and_dies_with_its_holder(workspace, monkeypatch):
    context = multiprocessing.get_context("spawn")
    holding, release = context.Event(), context.Event()
    holder = context.Process(target=hold, args=(workspace.root, holding, release))
    assert not workspace.is_locked
    holder.start()
    try:
        assert holding.wait(60)
        with pytest.raises(EnvironmentUnusable, match="another cotton3dg"), workspace.locked():
            pass
        for kernel in (lock.KERNEL, workspace.root / "no such file"):
            monkeypatch.setattr(lock, "KERNEL", kernel)
            assert workspace.is_locked
    finally:
        holder.kill()
        holder.join()
    assert not workspace.is_locked
    with workspace.locked():
        pass


def write_as_nobody(root, answers):
    os.setgid(65534)
    os.setuid(65534)
    try:
        write(Workspace(root), "one")
    except EnvironmentUnusable as error:
        answers.put(str(error))


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become a user without permission")
def test_a_read_only_folder_is_explained(workspace):
    for folder in (workspace.root, *workspace.root.parents):
        if not folder.stat().st_mode & stat.S_IXOTH:
            folder.chmod(0o755)
    context = multiprocessing.get_context("fork")
    answers = context.SimpleQueue()
    writer = context.Process(target=write_as_nobody, args=(workspace.root, answers))
    writer.start()
    writer.join(30)
    assert not answers.empty()
    assert "no permission to write" in answers.get()


@pytest.mark.parametrize(("free", "error"), [(1000, OutOfResources), (10**9, RuntimeError)])
def test_whatever_a_library_says_on_a_full_disk_is_explained(workspace, monkeypatch, free, error):
    """pycolmap: "No registered database factory succeeded"."""
    usage = shutil.disk_usage(workspace.root)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=free))
    with pytest.raises(error), workspace.writing("frames"):
        raise RuntimeError("No registered database factory succeeded.")
    assert not list(workspace.root.iterdir())
