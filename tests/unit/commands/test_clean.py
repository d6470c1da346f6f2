# SPDX-License-Identifier: Apache-2.0
"""What clean drops, what it never touches, and that nothing has to run again for it."""

import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from scenes.finished_scene import finished_workspace
from typer.testing import CliRunner

from cotton3dg import pipeline
from cotton3dg.cli.app import app
from cotton3dg.commands.clean import clean
from cotton3dg.errors import EnvironmentUnusable
from cotton3dg.workspace import Workspace


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    return finished_workspace(tmp_path_factory.mktemp("finished") / "plant").root


@pytest.fixture
def workspace(finished, tmp_path):
    return Workspace(shutil.copytree(finished, tmp_path / "plant"))


def files(workspace: Workspace) -> dict[str, bytes]:
    return {
        path.relative_to(workspace.root).as_posix(): path.read_bytes()
        for path in workspace.root.rglob("*")
        if path.is_file() and path.name != ".lock"
    }


def reasons(workspace: Workspace, stages=pipeline.STAGES, **changed) -> dict[str, str]:
    steps = pipeline.plan(workspace, pipeline.stage_options(workspace, overrides=changed), stages)
    return {step.stage: step.reason for step in steps if step.reason}


def test_only_images_go_and_every_stage_stays_up_to_date(workspace):
    before, stale = files(workspace), reasons(workspace)
    dropped = clean(workspace)
    after = files(workspace)
    gone = before.keys() - after.keys()
    assert dropped.finished
    assert dropped.n_files == len(gone)
    assert dropped.n_bytes == sum(len(before[name]) for name in gone) > 10_000
    assert {Path(name).parent.as_posix() for name in gone} == {"frames", "sfm/undistorted/images"}
    assert after.keys() - before.keys() == {"records/dropped.json"}
    assert {name: after[name] for name in before.keys() - gone} == {name: before[name] for name in before.keys() - gone}
    assert reasons(workspace) == stale
    assert clean(workspace).n_files == 0
    assert reasons(workspace) == stale


def test_a_report_keeps_its_photos(workspace, monkeypatch):
    report = partial(CliRunner().invoke, app, ["report", str(workspace.root)])
    assert "saved as" in report().output
    page = workspace.report_html.read_bytes()
    clean(workspace)
    assert "is up to date" in report().output
    monkeypatch.setattr("cotton3dg.report.page.__version__", "another version")
    assert "is up to date" in report().output
    assert workspace.report_html.read_bytes() == page
    workspace.write_record(replace(workspace.read_record("traits"), flags=("no_map",)))
    assert "saved as" in report().output


def test_what_a_stage_reads_is_made_again_first(workspace):
    assert reasons(workspace) == {}
    clean(workspace)
    again = reasons(workspace, scale={"table_width_cm": 50.0})
    assert list(again) == ["frames", "sfm", "scale", "masks", "segment", "cluster", "traits"]
    assert again["frames"] == "sfm reads what clean dropped"
    assert list(reasons(workspace, traits={"tube_height_cm": 5.0})) == ["frames", "sfm", "traits"]
    assert list(reasons(workspace, ("sfm",))) == ["frames", "sfm"]
    assert list(reasons(workspace, ("cluster",))) == []


def test_what_is_made_anew_is_vouched_for_by_nobody(workspace):
    clean(workspace)
    with workspace.writing("frames") as folder:
        (folder / "000000.jpg").write_bytes(b"new")
    assert not workspace.dropped(workspace.folder("frames"))
    assert workspace.dropped(workspace.undistorted)
    assert workspace.hashes(workspace.folder("frames")).keys() == {"frames/000000.jpg"}


def test_what_is_not_ours_or_was_changed_stays(workspace):
    changed = workspace.frame_images()[0]
    changed.write_bytes(b"retouched")
    own = [workspace.folder("frames") / "note.jpg.txt", workspace.root / ".thesis.partial", workspace.root / ".x.old"]
    own[0].touch()
    own[1].mkdir()
    own[2].touch()
    clean(workspace)
    assert changed.read_bytes() == b"retouched"
    assert all(path.exists() for path in own)


def test_an_unfinished_plant_only_loses_what_killed_runs_left(workspace):
    record = workspace.read_record("traits")
    workspace.write_record(replace(record, status="failed"))
    before = files(workspace)
    left = [
        workspace.root / ".train.partial" / "a.ply",
        workspace.root / ".sfm.old" / "deep" / "b.bin",
        workspace.root / ".check.x1y2.partial" / "frames" / "c.jpg",
        workspace.root / "records" / ".train.checkpoint.npz.partial",
        workspace.root / ".report.html.partial",
    ]
    for path in left:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"half")
    dropped = clean(workspace)
    assert (dropped.n_files, dropped.n_bytes, dropped.finished) == (5, 20, False)
    assert files(workspace) == before
    assert not (workspace.root / ".train.partial").exists()


def test_a_folder_at_work_is_left_alone(workspace):
    with workspace.locked(), pytest.raises(EnvironmentUnusable, match="another"):
        clean(workspace)


def test_damaged_notes_of_what_was_dropped_are_none(workspace):
    for text in ("{", "5", "[1]", '{"a": 1}', '["frames/x.jpg", "nowhere/y", ""]'):
        workspace.dropped_json.write_text(text)
        assert workspace.dropped() == {}
