# SPDX-License-Identifier: Apache-2.0
"""`cotton3dg check`: a verdict, its page, its exit code; and `run` goes on from what it did."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from scenes.tiny_plant import in_shell

from cotton3dg import pipeline
from cotton3dg.commands.check import check
from cotton3dg.commands.simulate import simulate
from cotton3dg.io import video
from cotton3dg.options import resolve
from cotton3dg.schemas.check import CheckInfo
from cotton3dg.sfm import reconstruction
from cotton3dg.sfm import stage as sfm
from cotton3dg.workspace import Workspace

OPTIONS = {"frames": {"count": 60}, "sfm": {"max_features": 1000, "overlap": 4}}


@pytest.fixture(scope="module")
def checked(filmed, tmp_path_factory):
    """A plant after a check that saw only the keyframes, and what that said."""
    root = tmp_path_factory.mktemp("checked")
    shutil.copyfile(filmed / "video.mp4", root / "video.mp4")
    workspace = Workspace(root)
    return workspace, check(workspace, pipeline.stage_options(workspace, overrides=OPTIONS), pipeline.Watcher())


def test_a_check_places_every_second_frame_and_saves_its_page(checked):
    workspace, info = checked
    assert 30 < info.figures["looked_at"] < 40  # every second one, the last, and what lies between unlike ones
    assert info.figures["placed"] >= 0.95 * info.figures["looked_at"]
    assert info.figures["orbit_coverage_deg"] > 340
    assert CheckInfo.load(workspace.check_json) == info
    page = workspace.check_html.read_text()
    assert info.line in page.replace("&#39;", "'")
    assert page.count("data:image/jpeg") >= 4
    assert workspace.read_record("sfm") is None


def test_run_goes_on_from_a_check_to_the_same_bits(checked, tmp_path, monkeypatch):
    workspace, _ = checked
    options = pipeline.stage_options(workspace, overrides=OPTIONS)
    plain = Workspace(shutil.copytree(workspace.root, tmp_path / "plain"))
    shutil.rmtree(plain.sfm_begun)
    pipeline.run(plain, options, ("frames", "sfm"))
    monkeypatch.delattr(reconstruction, "_map_keyframes")  # nothing is done twice
    resumed = Workspace(shutil.copytree(workspace.root, tmp_path / "resumed"))
    pipeline.run(resumed, options, ("frames", "sfm"))
    assert resumed.read_record("sfm").outputs == plain.read_record("sfm").outputs
    assert not resumed.sfm_begun.exists()


def test_what_was_begun_with_other_options_is_not_used(checked, tmp_path):
    workspace, _ = checked
    other = pipeline.stage_options(workspace, overrides=OPTIONS | {"sfm": {**OPTIONS["sfm"], "seed": 1}})
    same = pipeline.stage_options(workspace, overrides=OPTIONS)
    assert sfm._begun(workspace, same["sfm"])
    assert sfm._begun(workspace, other["sfm"]) is None
    damaged = Workspace(shutil.copytree(workspace.root, tmp_path / "damaged"))
    (damaged.sfm_begun / "features.npz").write_bytes(b"PK nonsense")
    assert sfm._begun(damaged, same["sfm"]) is None


def test_a_film_of_a_turntable_is_red_before_cameras_are_placed(tmp_path):
    film = {"frames": 64, "width": 320, "height": 180, "supersampling": 1, "turntable": True, "seed": 3}
    simulate(tmp_path, resolve("simulate", film))
    workspace = Workspace(tmp_path)
    info = check(workspace, pipeline.stage_options(workspace, "draft"), pipeline.Watcher())
    assert info.verdict == "red"
    assert "stands still, though the plant may turn" in info.line


def test_a_film_of_a_still_camera_is_red_and_exits_4(tmp_path):
    still = np.random.default_rng(0).integers(0, 255, (90, 160, 3), np.uint8)
    command = [video.ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-r", "12", "-s", "160x90"]
    frames = b"".join(np.clip(still + np.full((), k % 3, np.uint8), 0, 255).tobytes() for k in range(48))
    subprocess.run([*command, "-i", "pipe:0", str(tmp_path / "walk.mp4")], input=frames, check=True)
    done = in_shell("cotton3dg", "check", tmp_path / "walk.mp4", cwd=tmp_path)
    assert done.returncode == 4
    assert done.stdout.startswith("RED walk: the camera stands still; film one slow full turn")
    assert "see " in done.stdout
    assert "the camera stands still" in (tmp_path / "walk" / "check" / "check.html").read_text()
    told = in_shell("cotton3dg", "check", "--json", tmp_path / "walk", cwd=tmp_path)
    assert told.returncode == 4
    assert json.loads(told.stdout)["verdict"] == "red"
