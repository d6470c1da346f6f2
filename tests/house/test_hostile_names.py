# SPDX-License-Identifier: Apache-2.0
"""Folders with names that are not UTF-8, that cannot be read, or whose links lead in circles: the others are found."""

from __future__ import annotations

import csv
import errno
import io
import json
import logging
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cotton3dg import pipeline
from cotton3dg.batch import Batch, find_plants
from cotton3dg.cli.app import app
from cotton3dg.commands import import_ as module
from cotton3dg.commands.import_ import DOUBT, TABLE, Import, import_videos
from cotton3dg.errors import BadInput, EnvironmentUnusable
from cotton3dg.evaluation.repeatability import _plants_of
from cotton3dg.io.images import list_images
from cotton3dg.io.listing import files_below, is_there
from cotton3dg.io.saving import printable, write_text_atomically
from cotton3dg.schemas.batch import ReadVideo
from cotton3dg.schemas.record import Record
from cotton3dg.workspace import Workspace

LATIN = os.fsdecode(b"pl\xfcnze")


@pytest.fixture
def field(tmp_path: Path) -> Path:
    """Two sound plants among what else there may be."""
    try:
        (tmp_path / LATIN).mkdir()
    except OSError:
        pytest.skip("this file system has only names that are UTF-8")
    for name in ("a", "b", LATIN, "closed"):
        (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / name / "walk.mp4").write_text("film")
    for name in ("lost+found", "__MACOSX", ".Trash-0"):
        (tmp_path / name).mkdir()
    (tmp_path / "dangling").symlink_to("nowhere")
    (tmp_path / "round").symlink_to(".")
    (tmp_path / "row").mkdir()
    (tmp_path / "row" / "back").symlink_to(tmp_path / "file")
    (tmp_path / "file").mkdir()
    (tmp_path / "file" / "forth").symlink_to(tmp_path / "row")
    (tmp_path / "._walk.mp4").write_text("what macOS leaves")
    os.mkfifo(tmp_path / "pipe.mp4")
    return tmp_path


@pytest.fixture
def closed(field: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that may not be entered; root may enter all, so that the system calls have to say no."""

    def refusing(honest: Callable[..., Any], *, below: bool) -> Callable[..., Any]:
        def called(path: Any = ".", *arguments: Any, **named: Any) -> Any:
            name = os.fsdecode(path) if isinstance(path, str | bytes | os.PathLike) else ""
            if f"{field}/closed/" in name or (not below and name.endswith("/closed")):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), name)
            return honest(path, *arguments, **named)

        return called

    for name in ("listdir", "scandir", "open"):
        monkeypatch.setattr(os, name, refusing(getattr(os, name), below=False))
    monkeypatch.setattr(io, "open", refusing(io.open, below=False))
    monkeypatch.setattr(os, "stat", refusing(os.stat, below=True))
    return field / "closed"


def names_of(plants: list[Path], field: Path) -> list[str]:
    return [plant.relative_to(field).as_posix() for plant in plants]


def test_a_batch_runs_the_others(field: Path, closed: Path) -> None:
    plants = find_plants(field)
    assert {"a", "b", LATIN, "closed"} <= set(names_of(plants, field))
    assert not {"lost+found", "__MACOSX", "round", "dangling"} & set(names_of(plants, field))
    assert len(plants) < 8
    command = [
        sys.executable,
        "-c",
        "import os, sys; print(os.path.basename(sys.argv[1]) + ': no', file=sys.stderr); sys.exit(4)",
    ]
    Batch(field, tell=lambda line: None, command=command).run([field / "a", field / LATIN])
    with (field / "batch.csv").open(encoding="utf-8", newline="") as file:
        assert [row["folder"] for row in csv.DictReader(file)] == ["a", "pl\\udcfcnze"]
    assert "pl\\udcfcnze" in (field / "index.html").read_text(encoding="utf-8")


def test_who_compares_fields_gets_the_plants_that_can_be_read(field: Path, closed: Path) -> None:
    for name in ("a", LATIN):
        (field / name / "traits").mkdir()
        (field / name / "traits" / "traits.csv").write_text("x")
    assert _plants_of(field) == {"a": field / "a"}
    assert not is_there(closed / "traits" / "traits.csv")


def test_the_status_of_a_batch_names_such_a_plant_and_shows_the_others(field: Path) -> None:
    found = CliRunner().invoke(app, ["batch", str(field), "--status", "--json"])
    reasons = {row["folder"]: row["reason"] for row in json.loads(found.output)}
    assert "pl\\udcfcnze is not UTF-8; rename it" in reasons["pl\\udcfcnze"]
    assert reasons["a"] == "frames: no finished result"


@pytest.mark.parametrize("command", ["run", "check", "status", "frames", "report", "clean"])
def test_a_plant_of_such_a_name_is_refused_in_one_line_and_nothing_is_written(field: Path, command: str) -> None:
    found = CliRunner().invoke(app, [command, str(field / LATIN)])
    assert found.exit_code == BadInput.exit_code
    assert "pl\\udcfcnze is not UTF-8; rename it" in found.output
    assert found.output.count("\n") == 1
    assert [path.name for path in (field / LATIN).iterdir()] == ["walk.mp4"]


@pytest.mark.parametrize("command", ["run", "check", "status", "frames", "report"])
def test_a_plant_that_cannot_be_read_is_refused_in_one_line(closed: Path, command: str) -> None:
    found = CliRunner().invoke(app, [command, str(closed)])
    assert found.exit_code == EnvironmentUnusable.exit_code, found.output
    assert "no permission" in found.output
    assert found.output.count("\n") == 1


def test_a_film_or_photo_of_such_a_name_is_refused(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for path in (tmp_path / f"{LATIN}.mp4", tmp_path / "images" / f"{LATIN}.jpg"):
        path.write_text("x")
    with pytest.raises(BadInput, match=r"pl\\udcfcnze\.mp4 is not UTF-8; rename it"):
        Workspace(tmp_path).capture()
    with pytest.raises(BadInput, match=r"pl\\udcfcnze\.jpg is not UTF-8; rename it"):
        list_images(tmp_path / "images")


def test_an_import_takes_the_others_and_lists_these(
    field: Path, closed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (field / "b" / f"{LATIN}.mp4").write_text("another film")
    monkeypatch.setattr(module, "read_video", lambda path: ReadVideo(problem="no card; film it"))
    rows = import_videos([field], Import(field / "new"))
    reasons = {row.file.removeprefix(f"{field}/"): row.reason for row in rows}
    assert "is not UTF-8; rename it" in reasons["b/pl\\udcfcnze.mp4"]
    assert "is not UTF-8; rename it" in reasons["pl\\udcfcnze/walk.mp4"]
    assert "cannot be read (Permission denied); change its permissions" in reasons["closed"]
    assert reasons["a/walk.mp4"] == "no card; film it"
    assert "._walk.mp4" not in reasons
    assert {row.state for row in rows} <= {DOUBT, "left out"}
    assert "pl\\udcfcnze" in (field / "new" / TABLE).read_text(encoding="utf-8")


def test_a_walk_names_the_folders_that_it_could_not_read(closed: Path) -> None:
    refused: list[OSError] = []
    found = files_below(closed.parent, (".mp4",), refused.append)
    assert [path.parent.name for path in found] == ["a", "b", LATIN]
    assert [error.filename for error in refused] == [str(closed)]


def test_such_names_are_spelled_in_files_and_come_back_from_json(tmp_path: Path) -> None:
    assert printable(LATIN) == "pl\\udcfcnze"
    assert printable("pflänzchen") == "pflänzchen"
    write_text_atomically(tmp_path / "a.csv", f"{LATIN},ä\n")
    assert (tmp_path / "a.csv").read_bytes() == "pl\\udcfcnze,ä\n".encode()
    Record("frames", error=LATIN).save(tmp_path / "a.json")
    assert Record.load(tmp_path / "a.json").error == LATIN


@pytest.fixture
def logged(tmp_path: Path) -> Iterator[Path]:
    (tmp_path / "walk.mp4").write_text("film")
    with pipeline._logged(Workspace(tmp_path)):
        yield tmp_path / "run.log"


def test_such_names_are_spelled_in_the_log(logged: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # To the file alone: pytest-xdist cannot send such names of a record that pytest itself has seen.
    (handler,) = (handler for handler in pipeline.log.handlers if type(handler) is logging.FileHandler)
    handler.handle(logging.makeLogRecord({"msg": "of %s", "args": (LATIN,), "levelname": "INFO"}))
    assert "of pl\\udcfcnze" in logged.read_text(encoding="utf-8")
    assert "Traceback" not in capsys.readouterr().err
