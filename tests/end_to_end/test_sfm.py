# SPDX-License-Identifier: Apache-2.0
"""From a clip to cameras: a textured room with a box in it, filmed on a full turn, with exact truth."""

import json
import subprocess

import cv2
import numpy as np
import pytest
from scenes.documents import frame_info, frames_info
from scenes.room_scene import FOCAL_PX, HEIGHT, RADIUS, WIDTH, pose, render, textures

from cotton3dg import pipeline
from cotton3dg.errors import BadInput, CaptureFailed, MissingInput
from cotton3dg.io import video
from cotton3dg.io.colmap import read_cameras, read_points, read_positions, read_tracks
from cotton3dg.io.images import read_image, write_image
from cotton3dg.sfm import keyframes
from cotton3dg.workspace import Workspace

N_FILMED, N_TAKEN = 60, 30
OPTIONS = {"frames": {"count": N_TAKEN}, "sfm": {"max_features": 1500, "overlap": 6}}


def film(path, frames):
    command = [video.ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-r", "24"]
    command += ["-s", f"{WIDTH}x{HEIGHT}", "-i", "pipe:0", "-pix_fmt", "yuv420p", "-crf", "12", str(path)]
    subprocess.run(command, input=b"".join(frame.tobytes() for frame in frames), check=True)


@pytest.fixture(scope="module")
def angles():
    return np.linspace(0, 2 * np.pi, N_FILMED, endpoint=False)


@pytest.fixture(scope="module")
def plant(tmp_path_factory, angles):
    """A workspace after frames and sfm."""
    root = tmp_path_factory.mktemp("plant")
    faces = textures()
    film(root / "video.mp4", [render(faces, angle) for angle in angles])
    workspace = Workspace(root)
    options = pipeline.stage_options(workspace, overrides=OPTIONS)
    pipeline.run(workspace, options, ("frames", "sfm"))
    return workspace


def cameras_of(plant):
    return read_cameras(plant.undistorted / "sparse")


def similarity(source, target):
    """Scale, rotation, translation that map points onto points best (Umeyama 1991)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    signs = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * signs) @ vt
    scale = (s * signs).sum() / (a**2).sum()
    return scale, rotation, target.mean(axis=0) - scale * rotation @ source.mean(axis=0)


def test_poses_are_those_of_the_film(plant, angles):
    cameras = cameras_of(plant)
    entries = {entry["name"]: entry for entry in json.loads(plant.frames_json.read_text())["images"]}
    assert len(cameras) == N_TAKEN
    truth = [pose(angles[entries[camera.name]["source_index"]]) for camera in cameras]
    centres = np.array([centre for _, centre in truth])
    scale, rotation, translation = similarity(np.array([camera.centre for camera in cameras]), centres)
    for camera, (true_rotation, true_centre) in zip(cameras, truth, strict=True):
        assert np.linalg.norm(scale * rotation @ camera.centre + translation - true_centre) < 0.01 * RADIUS
        turn = camera.rotation @ rotation.T @ true_rotation.T
        assert np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))) < 0.5
    assert cameras[0].fx == pytest.approx(FOCAL_PX, rel=0.01)


def test_sfm_json_tells_the_truth(plant):
    told = json.loads(plant.sfm_json.read_text())
    assert told["registered_pct"] == 100 and told["unregistered"] == []
    assert told["orbit_coverage_deg"] > 330 and told["orbit_largest_gap_deg"] < 30
    assert told["mean_reprojection_error_px"] < 0.8
    record = plant.read_record("sfm")
    assert record.flags == () and record.warnings == ()
    assert set(record.parts_s) == {"features", "matching", "mapping", "colours", "deciding the lens", "undistorting"}
    assert sum(record.parts_s.values()) == pytest.approx(record.seconds, rel=0.1, abs=0.5)


def test_undistorted_images_fit_their_cameras(plant):
    """Points that stand on the walls in the model show the colours of the undistorted images where they project."""
    cameras = cameras_of(plant)
    xyz, rgb, errors, lengths = read_points(plant.undistorted / "sparse")
    assert len(xyz) > 500 and (errors >= 0).all() and (lengths >= 2).all()
    camera = cameras[3]
    picture = read_image(plant.undistorted_image(camera.name))
    assert picture.shape == (camera.height, camera.width, 3)
    pixels, depths = camera.project(xyz)
    seen = (depths > 0) & ((pixels >= 1) & (pixels < (camera.width - 1, camera.height - 1))).all(axis=1)
    at = pixels[seen].astype(int)
    error = np.abs(picture[at[:, 1], at[:, 0]].astype(int) - rgb[seen]).mean(axis=1)
    shuffled = np.abs(picture[at[:, 1], at[:, 0]].astype(int) - np.roll(rgb[seen], 1, axis=0)).mean(axis=1)
    assert np.median(error) < 0.5 * np.median(shuffled)


def test_other_programs_find_their_files(plant):
    transforms = json.loads((plant.sfm_model / "transforms.json").read_text())
    assert len(transforms["frames"]) == N_TAKEN
    assert all((plant.sfm_model / frame["file_path"]).is_file() for frame in transforms["frames"])
    assert np.load(plant.sfm_model / "poses_bounds.npy", allow_pickle=False).shape == (N_TAKEN, 17)
    left_over = {path.name for path in plant.sfm_model.iterdir()} | {path.name for path in plant.undistorted.iterdir()}
    assert not [name for name in left_over if name.endswith((".db", ".sh", ".txt")) or name == "stereo"]


def test_points_have_the_colours_of_the_images(tmp_path, angles, monkeypatch):
    """Those of keyframes and those that the other images have added."""
    monkeypatch.setattr(keyframes, "KEYFRAMES", N_FILMED // 2)
    faces = textures()
    workspace = frames_only(tmp_path, [render(faces, angle) for angle in angles])
    run_sfm(workspace, overlap=12)
    sparse = workspace.undistorted / "sparse"
    ids, colours = read_positions(sparse)[0], read_points(sparse)[1].astype(float)
    differences = []
    for name, (places_px, points) in read_tracks(sparse).items():
        x, y = places_px.astype(int).T
        shown = read_image(workspace.undistorted_image(name))[y, x]
        differences.append(np.abs(shown - colours[np.searchsorted(ids, points)]))
    assert np.concatenate(differences).mean() < 8


def test_the_same_bits_again(plant):
    before = plant.read_record("sfm").outputs
    pipeline.run(plant, pipeline.stage_options(plant, overrides=OPTIONS), ("sfm",), force=True)
    assert plant.read_record("sfm").outputs == before


def frames_only(tmp_path, pictures, ordered=True):
    """A workspace whose frames are given."""
    workspace = Workspace(tmp_path)
    with workspace.writing("frames") as folder:
        names = [f"{number:06d}.jpg" for number in range(len(pictures))]
        for name, picture in zip(names, pictures, strict=True):
            write_image(folder / name, picture)
        frames_info([frame_info(name) for name in names], ordered).save(folder / "frames.json")
    return workspace


def run_sfm(workspace, **overrides):
    from cotton3dg.sfm import stage as sfm

    chosen = {**OPTIONS, "sfm": {**OPTIONS["sfm"], **overrides}}
    options = pipeline.stage_options(workspace, overrides=chosen)["sfm"]
    return sfm.run(workspace, options, lambda *_: None)


def test_images_of_a_straight_lens_stay_as_they_are(plant):
    decision = json.loads(plant.sfm_json.read_text())["distortion"]
    assert decision["option"] == "auto" and decision["on"] is False
    assert decision["rise_pct"] < decision["needed_from_pct"]
    for camera in cameras_of(plant):
        assert (camera.width, camera.height, camera.cx, camera.cy) == (WIDTH, HEIGHT, WIDTH / 2, HEIGHT / 2)
        frame = plant.folder("frames") / camera.name
        assert plant.undistorted_image(camera.name).read_bytes() == frame.read_bytes()


def test_a_bent_lens_is_told_and_straightened(tmp_path, angles):
    faces = textures()
    turn = [(render(faces, angle, k1=-0.05), render(faces, angle)) for angle in angles[::2]]
    workspace = frames_only(tmp_path, [bent for bent, _ in turn])
    run_sfm(workspace)
    decision = json.loads(workspace.sfm_json.read_text())["distortion"]
    assert decision["on"] is True and decision["corner_px"] == pytest.approx(5.4, rel=0.2)
    cameras = cameras_of(workspace)
    assert len(cameras) == len(turn)
    for camera, (_, straight) in list(zip(cameras, turn, strict=True))[::5]:
        undistorted = read_image(workspace.undistorted_image(camera.name)).astype(float)
        x, y = np.meshgrid(
            (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx,
            (np.arange(camera.height) + 0.5 - camera.cy) / camera.fy,
        )
        expected = cv2.remap(
            straight,
            (x * FOCAL_PX + WIDTH / 2 - 0.5).astype(np.float32),
            (y * FOCAL_PX + HEIGHT / 2 - 0.5).astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        inside = (slice(20, -20), slice(20, -20))
        shifted = np.abs(np.roll(expected, 2, axis=1) - expected)[inside].mean()
        assert np.abs(undistorted - expected)[inside].mean() < 0.6 * shifted


@pytest.mark.parametrize(("option", "on"), [("on", True), ("off", False)])
def test_distortion_can_be_forced(tmp_path, plant, option, on):
    workspace = frames_only(tmp_path, [read_image(path) for path in plant.frame_images()])
    run_sfm(workspace, distortion=option)
    assert json.loads(workspace.sfm_json.read_text())["distortion"]["on"] is on
    n_bent = sum(
        workspace.undistorted_image(path.name).read_bytes() != path.read_bytes() for path in workspace.frame_images()
    )
    assert n_bent == (N_TAKEN if on else 0)


def test_unrelated_images_are_refused_with_advice(tmp_path):
    rng = np.random.default_rng(0)
    workspace = frames_only(tmp_path, [rng.integers(0, 255, (120, 160, 3), np.uint8) for _ in range(12)])
    with pytest.raises(CaptureFailed, match=r"0 of 12 frames registered \(40 % needed\); .*--set frames.count=24"):
        run_sfm(workspace)
    assert not workspace.sfm_model.exists()


def test_turning_on_the_spot_is_refused(tmp_path):
    """Without a baseline there is no depth; COLMAP then bends the lens until a short arc fits."""
    rng = np.random.default_rng(0)
    wall = cv2.resize(rng.integers(0, 255, (100, 160, 3), np.uint8), (1200, 750))
    k, k_wall = (np.array([[FOCAL_PX, 0, x], [0, FOCAL_PX, y], [0, 0, 1]]) for x, y in ((200, 150), (600, 375)))
    pictures = []
    for yaw in np.radians(np.linspace(-18, 18, 14)):
        turn = cv2.Rodrigues(np.array([0.1 * yaw, yaw, 0.0]))[0]
        pictures.append(cv2.warpPerspective(wall, k @ turn @ np.linalg.inv(k_wall), (WIDTH, HEIGHT)))
    workspace = frames_only(tmp_path, pictures)
    with pytest.raises(CaptureFailed, match=r"of 14 frames registered|degrees around|points that others show"):
        run_sfm(workspace)


def test_flat_images_are_refused(tmp_path):
    workspace = frames_only(tmp_path, [np.full((120, 160, 3), 90, np.uint8)] * 10)
    with pytest.raises(CaptureFailed, match="0 of 10"):
        run_sfm(workspace)


def test_missing_and_damaged_frames_are_named(tmp_path):
    with pytest.raises(MissingInput, match="cotton3dg frames"):
        run_sfm(Workspace(tmp_path))
    workspace = frames_only(tmp_path, [np.full((120, 160, 3), 90, np.uint8)] * 10)
    workspace.frames_json.write_text("{")
    with pytest.raises(BadInput, match=r"frames\.json is damaged"):
        run_sfm(workspace)
