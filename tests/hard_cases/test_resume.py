# SPDX-License-Identifier: Apache-2.0
"""Hard cases 51 and 54: training that is interrupted, and steps that cannot be taken."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes.splat_scenes import arrays_of, camera_at, scene, step
from scenes.training_scene import OPTIONS, training_scene

from cotton3dg import pipeline
from cotton3dg.core.scene import Gaussians
from cotton3dg.errors import StageFailed
from cotton3dg.gaussians.rasterizer import train_step
from cotton3dg.io.arrays import read_arrays
from cotton3dg.io.images import read_image, write_image
from cotton3dg.io.ply import read_gaussians
from cotton3dg.options import TrainOptions
from cotton3dg.train import stage as train
from cotton3dg.train import trainer
from cotton3dg.train.checkpoint import read_training, write_training
from cotton3dg.train.schedule import densification_steps
from cotton3dg.train.trainer import Training, fit
from cotton3dg.workspace import Workspace

LONG = replace(OPTIONS, steps=300, sh_degree=2)
STAGE_OPTIONS = TrainOptions(steps=400, max_gaussians=400, sh_degree=1, max_side=64)


def saved_at(steps: set[int], folder: Path, monkeypatch: pytest.MonkeyPatch, options: TrainOptions) -> Gaussians:
    """An undisturbed training of the made scene that writes its state down after each of `steps`; its result."""
    start, views, _ = training_scene()
    start = replace(start, sh=np.pad(start.sh, ((0, 0), (0, 8), (0, 0))))
    monkeypatch.setattr(trainer, "SAVED_EVERY_S", 0.0)

    def save(training: Training) -> None:
        if training.step in steps:
            write_training(folder / f"{training.step}.npz", training, "key")

    return fit(start, views, options, save=save).gaussians


def test_case_51_resume_from_any_step_ends_in_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stop points around density control, a rising SH degree, a history entry, the first and the last step."""
    _, views, _ = training_scene()
    densifications = list(densification_steps(LONG.steps, len(views)))
    first, last = densifications[0], densifications[-1]
    steps = {1, 2, 46, 50, 60, 90, 137, first - 1, first, first + 1, last - 1, last, last + 1, 299, 300}
    assert len(steps) >= 10
    straight = saved_at(steps, tmp_path, monkeypatch, LONG)
    for at in sorted(steps):
        training = read_training(tmp_path / f"{at}.npz", "key")
        assert training is not None
        assert training.step == at
        resumed = fit(training, views, LONG)
        assert resumed.gaussians.sha256() == straight.sha256(), at
        assert [entry["step"] for entry in resumed.history] == [50, 100, 150, 200, 250, 300]
        assert resumed.n_split > 0


def test_case_51_a_checkpoint_of_something_else_or_a_damaged_one_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    saved_at({10}, tmp_path, monkeypatch, replace(OPTIONS, steps=11))
    path = tmp_path / "10.npz"
    assert read_training(path, "key") is not None
    assert read_training(tmp_path / "none.npz", "key") is None
    assert not caplog.records
    assert read_training(path, "another key") is None
    assert "of another version, other options or other images; training starts" in caplog.text
    caplog.clear()
    whole = path.read_bytes()
    half = len(whole) // 2  # amid an array: nobody reads all of the headers between them
    for damaged in (b"", whole[:100], whole[:-30], whole[:half] + bytes([whole[half] ^ 0xFF]) + whole[half + 1 :]):
        path.write_bytes(damaged)
        assert read_training(path, "key") is None
        assert "starts from the beginning" in caplog.text
        caplog.clear()


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    """A workspace after sfm, of the made scene."""
    import pycolmap

    truth_start, views, _ = training_scene()
    workspace = Workspace(tmp_path)
    model = pycolmap.Reconstruction()
    first = views[0].camera
    camera = pycolmap.Camera(
        camera_id=1, model="PINHOLE", width=first.width, height=first.height,
        params=[first.fx, first.fy, first.cx, first.cy],
    )  # fmt: skip
    model.add_camera_with_trivial_rig(camera)
    for number, view in enumerate(views, 1):
        image = pycolmap.Image(name=f"{number:06d}.jpg", camera_id=1, image_id=number)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(view.camera.cam_from_scene))
    for point in truth_start.means:
        model.add_point3D(point.astype(np.float64), pycolmap.Track(), np.full(3, 128, np.uint8))
    (workspace.undistorted / "sparse").mkdir(parents=True)
    (workspace.undistorted / "images").mkdir()
    model.write_binary(workspace.undistorted / "sparse")
    for number, view in enumerate(views, 1):
        write_image(workspace.undistorted_image(f"{number:06d}.jpg"), view.image)
    return workspace


KILLED = """
import sys
from cotton3dg.options import TrainOptions
from cotton3dg.train import stage, trainer
from cotton3dg.workspace import Workspace
trainer.SAVED_EVERY_S = 0.05
stage.run(Workspace(sys.argv[1]), TrainOptions(steps=400, max_gaussians=400, sh_degree=1, max_side=64))
"""


def test_case_51_killed_in_training_the_next_run_goes_on_and_ends_in_the_same_bits(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    began_at: list[int] = []
    honest = train.fit

    def noted(start, *arguments, **named):
        began_at.append(start.step if isinstance(start, Training) else 0)
        return honest(start, *arguments, **named)

    monkeypatch.setattr(train, "fit", noted)
    train.run(workspace, STAGE_OPTIONS)
    straight = workspace.gaussians_ply.read_bytes()
    for _ in range(2):
        process = subprocess.Popen([sys.executable, "-c", KILLED, str(workspace.root)])
        until = time.monotonic() + 60
        while not workspace.train_checkpoint.exists() and process.poll() is None and time.monotonic() < until:
            time.sleep(0.005)
        process.send_signal(signal.SIGKILL)
        assert process.wait(60) == -signal.SIGKILL
    assert workspace.train_checkpoint.exists()
    train.run(workspace, STAGE_OPTIONS)
    assert began_at[0] == 0
    assert 0 < began_at[1] < STAGE_OPTIONS.steps
    assert workspace.gaussians_ply.read_bytes() == straight
    assert not workspace.train_checkpoint.exists()
    assert not [path for path in (workspace.root / "records").iterdir() if path.name.endswith(".partial")]


def test_case_51_other_options_or_images_never_continue_a_training(workspace: Workspace) -> None:
    key = train._training_key(workspace, STAGE_OPTIONS)
    assert train._training_key(workspace, replace(STAGE_OPTIONS, seed=1)) != key
    photo = next((workspace.undistorted / "images").iterdir())
    write_image(photo, 255 - read_image(photo))
    assert train._training_key(workspace, STAGE_OPTIONS) != key


def test_case_54_a_step_that_is_not_finite_changes_nothing() -> None:
    """A NaN background stands for any unknown cause."""
    camera, gaussians = camera_at(30, 20), scene(20, seed=0)
    before = gaussians.sha256()
    report, adam, statistics = step(gaussians, camera, background=(np.nan, 0.0, 0.0))
    assert not report.finite
    assert gaussians.sha256() == before
    assert not adam.steps.any()
    assert not any(array.any() for array in (*arrays_of(adam.first), *arrays_of(adam.second)))
    assert not any(array.any() for array in vars(statistics).values())


def spoil(monkeypatch: pytest.MonkeyPatch, spoilt: set[int]) -> None:
    """Give the steps with these numbers a background that makes the loss NaN."""
    calls = iter(range(10**6))

    def spoiling(*arguments, **options):
        if next(calls) in spoilt:
            options["background"] = (np.nan, 0.0, 0.0)
        return train_step(*arguments, **options)

    monkeypatch.setattr(trainer, "train_step", spoiling)


def test_case_54_training_goes_on_and_keeps_what_the_step_was_given(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil(monkeypatch, {30, 70})
    outcome = train.run(workspace, STAGE_OPTIONS)
    assert "training_steps_rejected" in outcome.flags
    assert "records/train.rejected.npz" in "".join(outcome.warnings)
    rejected = json.loads(workspace.metrics_json.read_text())["rejected_steps"]
    assert [entry["step"] for entry in rejected] == [30, 70]
    assert read_gaussians(workspace.gaussians_ply).finite_rows.all()
    kept = read_arrays(workspace.train_rejected)
    facts = json.loads(str(kept["facts"]))
    assert facts["step"] == 30
    assert facts["camera"]["name"] == rejected[0]["image"]
    assert kept["image"].shape == (facts["camera"]["height"], facts["camera"]["width"], 3)
    assert np.isfinite(kept["means"]).all()
    monkeypatch.undo()
    train.run(workspace, STAGE_OPTIONS)
    assert not workspace.train_rejected.exists()


def test_case_54_too_many_such_steps_end_the_stage_with_the_reason_and_the_evidence(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil(monkeypatch, set(range(5, 400)))
    options = pipeline.stage_options(workspace)
    (workspace.root / "images").mkdir()
    with pytest.raises(StageFailed, match="not finite in 11 of 16 steps"):
        pipeline.run(workspace, options | {"train": STAGE_OPTIONS}, ("train",))
    record = workspace.read_record("train")
    assert record is not None
    assert "leave out that image" in record.error
    assert workspace.train_rejected.exists()
    assert not workspace.gaussians_ply.exists()
