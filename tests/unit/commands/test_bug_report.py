# SPDX-License-Identifier: Apache-2.0
"""`cotton3dg bug-report`: what is packed, and that nothing personal is without being asked for."""

import zipfile
from pathlib import Path

import pytest
from scenes.finished_scene import finished_workspace
from typer.testing import CliRunner

from cotton3dg import __version__
from cotton3dg.cli.app import app
from cotton3dg.commands.bug_report import pack
from cotton3dg.errors import BadUsage
from cotton3dg.workspace import Workspace


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    workspace = finished_workspace(tmp_path_factory.mktemp("plants") / "plant_017")
    workspace.log_file.write_text(f"INFO read {Path.home()}/plants/video.mp4\n")
    return workspace


def packed(file):
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_log_records_documents_and_versions_are_packed_without_images(plant, tmp_path):
    found = packed(pack(plant, tmp_path / "a.zip", "memory: 8 GiB\n"))
    stages = {f"records/{path.name}" for path in (plant.root / "records").glob("*.json")}
    assert stages
    assert stages | {"machine.txt", "run.log", "traits/traits.csv"} <= set(found)
    assert not [name for name in found if name.endswith((".jpg", ".png", ".ply", ".mp4", ".html"))]
    assert found["run.log"] == b"INFO read ~/plants/video.mp4\n"
    machine = found["machine.txt"].decode()
    assert machine.startswith(f"cotton3dg {__version__}")
    assert "\nnumpy==" in machine
    assert machine.endswith("memory: 8 GiB\n")


def test_images_are_packed_when_asked_for(plant, tmp_path):
    found = packed(pack(plant, tmp_path / "b.zip", "", images=True))
    assert [name for name in found if name.startswith("frames/") and name.endswith(".jpg")]


def test_there_must_be_something_to_report(plant, tmp_path):
    (tmp_path / "new").mkdir()
    with pytest.raises(BadUsage, match="nothing was run"):
        pack(Workspace(tmp_path / "new"), tmp_path / "c.zip", "")
    with pytest.raises(BadUsage, match=r"\.zip"):
        pack(plant, tmp_path / "c.tar", "")


def test_the_command_adds_what_doctor_finds(plant, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["bug-report", str(plant.root)])
    assert result.exit_code == 0, result.output
    assert "C++ core: instruction set" in packed(tmp_path / "bug_report_plant_017.zip")["machine.txt"].decode()
