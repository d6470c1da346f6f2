# SPDX-License-Identifier: Apache-2.0
"""Hard cases 36 and 37: structure from motion that finds several models, or the wrong one, or none."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from scenes.documents import frame_info, frames_info
from scenes.room_scene import FOCAL_PX, HEIGHT, RADIUS, WIDTH, pose, render, textures

from cotton3dg import pipeline
from cotton3dg.errors import BadInput, CaptureFailed
from cotton3dg.io.images import write_image
from cotton3dg.sfm import reconstruction
from cotton3dg.sfm.registration_quality import require_registered
from cotton3dg.workspace import Workspace

OPTIONS = {"sfm": {"max_features": 1500, "overlap": 6}}


def frames(folder: Path, pictures: list[np.ndarray], **described: Any) -> Workspace:
    """A workspace whose frames are given."""
    workspace = Workspace(folder)
    workspace.images_input.mkdir()
    with workspace.writing("frames") as partial:
        names = [f"{number:06d}.jpg" for number in range(len(pictures))]
        for name, picture in zip(names, pictures, strict=True):
            write_image(partial / name, picture)
        replace(frames_info([frame_info(name) for name in names]), **described).save(partial / "frames.json")
    return workspace


def run_sfm(workspace: Workspace) -> dict:
    pipeline.run(workspace, pipeline.stage_options(workspace, overrides=OPTIONS), ("sfm",))
    return json.loads(workspace.sfm_json.read_text())


def full_turn(seed: int, count: int) -> list[np.ndarray]:
    faces = textures(seed)
    return [render(faces, angle) for angle in np.linspace(0, 2 * np.pi, count, endpoint=False)]


@pytest.mark.slow
def test_case_36_of_two_places_the_one_with_more_images_is_taken_and_the_rest_is_told(tmp_path: Path) -> None:
    workspace = frames(tmp_path, full_turn(1, 30) + full_turn(2, 30)[:10])
    told = run_sfm(workspace)
    assert set(told["registered"]) == {f"{number:06d}.jpg" for number in range(30)}
    assert told["unregistered"] == [f"{number:06d}.jpg" for number in range(30, 40)]
    record = workspace.read_record("sfm")
    assert record.flags == ("few_frames_registered",)
    assert "30 of 40" in record.warnings[0]
    assert told["n_models"] == 2


def test_case_36_models_are_ordered_by_images_then_points(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import pycolmap

    def model(images: int, points: int) -> SimpleNamespace:
        return SimpleNamespace(num_reg_images=lambda: images, num_points3D=lambda: points, reg_image_ids=lambda: [])

    found = {0: model(5, 900), 1: model(20, 100), 2: model(20, 300), 3: model(3, 5000)}
    for part in ("features_of_images", "match_pairs"):
        monkeypatch.setattr(reconstruction, part, lambda *_: {})
    for part in ("write_database", "bundle_adjust"):
        monkeypatch.setattr(reconstruction, part, lambda *_: None)
    monkeypatch.setattr(reconstruction, "recover_registration", lambda _, first: (first, ()))
    monkeypatch.setattr(pycolmap, "incremental_mapping", lambda *_, **__: found)
    settings = reconstruction.ReconstructionSettings(100, 100, 0)
    models = reconstruction.reconstruct(tmp_path, ["a", "b"], [(0, 1)], tmp_path, settings).models
    assert [(m.num_reg_images(), m.num_points3D()) for m in models] == [(20, 300), (20, 100), (5, 900), (3, 5000)]


def test_case_36_a_small_share_of_the_images_is_refused() -> None:
    model = SimpleNamespace(num_reg_images=lambda: 39)
    with pytest.raises(CaptureFailed, match=r"39 of 100 frames registered \(40 % needed\)"):
        require_registered([model], [str(i) for i in range(100)])
    require_registered([SimpleNamespace(num_reg_images=lambda: 40)], [str(i) for i in range(100)])


def assert_refused_or_right(workspace: Workspace, angles: np.ndarray) -> None:
    """Exit code 4 with advice, or the true shape of the orbit and focal length; nothing in between."""
    try:
        told = run_sfm(workspace)
    except CaptureFailed as refusal:
        assert refusal.exit_code == 4
        assert any(said in str(refusal) for said in ("registered", "degrees around", "points that others show"))
        assert "; film" in str(refusal)
        assert not workspace.sfm_model.exists()
        return
    assert told["focal_length_px"] == pytest.approx(FOCAL_PX, rel=0.03)
    assert told["orbit_coverage_deg"] == pytest.approx(np.degrees(np.ptp(angles)), abs=25)


def test_case_37_no_initial_pair(tmp_path: Path) -> None:
    """Every image of another place."""
    pictures = [render(textures(seed), 0.0) for seed in range(3, 13)]
    workspace = frames(tmp_path, pictures)
    with pytest.raises(CaptureFailed, match=r"of 10 frames registered.*--set frames\.count=20") as refusal:
        run_sfm(workspace)
    assert refusal.value.exit_code == 4


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_case_37_a_wrong_focal_length_is_corrected_or_refused(tmp_path: Path, factor: float) -> None:
    """As EXIF may say after cropping or zooming."""
    angles = np.linspace(0, 2 * np.pi, 30, endpoint=False)
    assert_refused_or_right(frames(tmp_path, full_turn(1, 30), focal_length_px=factor * FOCAL_PX), angles)


def test_case_37_a_scene_that_is_one_plane_is_right_or_refused(tmp_path: Path) -> None:
    """A poster on the floor and nothing else, from a full turn: focal length and pose can trade places."""
    rng = np.random.default_rng(0)
    poster = cv2.resize(rng.integers(0, 255, (90, 90, 3), np.uint8), (900, 900), interpolation=cv2.INTER_CUBIC)
    angles, pictures = np.linspace(0, 2 * np.pi, 30, endpoint=False), []
    for angle in angles:
        rotation, centre = pose(angle)
        k = np.array([[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HEIGHT / 2], [0, 0, 1]])
        # Poster pixels to points (x, y, 0) of 1.6 x 1.6 around the middle of the orbit, to the image.
        to_scene = np.array([[1.6 / 900, 0, -0.8], [0, 1.6 / 900, -0.8], [0, 0, 1]])
        homography = k @ np.column_stack([rotation[:, 0], rotation[:, 1], -rotation @ centre]) @ to_scene
        pictures.append(cv2.warpPerspective(poster, homography, (WIDTH, HEIGHT)))
    assert_refused_or_right(frames(tmp_path, pictures), angles)


def test_case_37_one_image_over_and_over(tmp_path: Path) -> None:
    workspace = frames(tmp_path, [render(textures(), 0.3)] * 10)
    with pytest.raises(CaptureFailed, match="the camera stands still"):
        run_sfm(workspace)


def test_case_38_a_model_of_lost_poses_only_is_refused(tmp_path: Path) -> None:
    """`-nan(ind)`, as a failed bundle adjustment leaves behind; what the exports are made of stays finite."""
    from cotton3dg.io.colmap import read_cameras

    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QiiQQ4d", 1, 1, 1, 40, 30, 50.0, 50.0, 20.0, 15.0))
    lost = np.array([0xFFF8000000000000], np.uint64).view(np.float64)[0]
    poses = [(lost,) * 7, (1.0, 0, 0, 0, lost, 0, 0), (1.0, 0, 0, 0, 0, 0, RADIUS)]
    images = [struct.pack("<I7dI", i, *p, 1) + b"%d.jpg\0" % i + struct.pack("<Q", 0) for i, p in enumerate(poses)]
    (tmp_path / "images.bin").write_bytes(struct.pack("<Q", 3) + b"".join(images))
    assert [camera.name for camera in read_cameras(tmp_path)] == ["2.jpg"]
    (tmp_path / "images.bin").write_bytes(struct.pack("<Q", 2) + b"".join(images[:2]))
    with pytest.raises(BadInput, match="no image with a pose"):
        read_cameras(tmp_path)
