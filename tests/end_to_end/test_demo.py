# SPDX-License-Identifier: Apache-2.0
"""`cotton3dg demo` on a plant that is filmed already: it is run and judged, and a second call does neither again."""

import json
import shutil

from scenes.tiny_plant import OPTIONS
from typer.testing import CliRunner

from cotton3dg.cli.app import app
from cotton3dg.workspace import Workspace


def test_the_demo_ends_with_the_row_and_the_truth(filmed, tmp_path):
    plant = Workspace(shutil.copytree(filmed, tmp_path / "demo"))
    (plant.root / "cotton3dg.toml").write_text(OPTIONS)
    film = (plant.root / "video.mp4").read_bytes()
    first = CliRunner().invoke(app, ["demo", str(plant.root)])
    assert first.exit_code == 0, first.output
    assert "plant_height_cm" in first.stdout
    assert " of 6 found" in first.stdout
    assert (plant.root / "video.mp4").read_bytes() == film
    before = plant.read_record("train")
    assert CliRunner().invoke(app, ["demo", str(plant.root)]).stdout == first.stdout
    assert plant.read_record("train") == before
    entries = json.loads(CliRunner().invoke(app, ["status", str(plant.root), "--json"]).stdout)
    assert {(entry["state"], entry["preset"]) for entry in entries} == {("done", "draft")}
