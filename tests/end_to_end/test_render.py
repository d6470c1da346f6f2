# SPDX-License-Identifier: Apache-2.0
"""Films of a made plant on its table: files of the stages before in, video and images out."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pycolmap
import pytest
from scenes.documents import frames_info, table_scale, train_metrics
from scenes.table_scene import POSE, TOP_CM, orbit, plant_scene

from cotton3dg.commands.render import _order_cameras, render
from cotton3dg.core.bolls import BollInstance
from cotton3dg.errors import BadInput, BadUsage, MissingInput, NoBolls
from cotton3dg.gaussians import rasterizer
from cotton3dg.gaussians.appearance import boll_colours
from cotton3dg.gaussians.metrics import to_uint8
from cotton3dg.geometry.camera_paths import reframe, walk
from cotton3dg.io.colmap import read_cameras
from cotton3dg.io.images import list_images, read_image
from cotton3dg.io.ply import read_gaussians, write_gaussians
from cotton3dg.io.video import probe, read_frames
from cotton3dg.options import RenderOptions, TraitsOptions
from cotton3dg.schemas.bolls import describe_bolls
from cotton3dg.schemas.record import Record
from cotton3dg.traits import stage as traits
from cotton3dg.workspace import Workspace

SMALL = RenderOptions(frames=6, width=160, height=120)
N_VIEWS = 20


def write_cameras(folder):
    views, model = orbit(N_VIEWS), pycolmap.Reconstruction()
    lens = views[0]
    camera = pycolmap.Camera(
        model="PINHOLE", width=lens.width, height=lens.height, params=[lens.fx, lens.fy, lens.cx, lens.cy], camera_id=1
    )
    model.add_camera_with_trivial_rig(camera)
    for i, view in enumerate(views, 1):
        image = pycolmap.Image(name=view.name, camera_id=1, image_id=i)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(view.cam_from_scene))
    folder.mkdir(parents=True)
    model.write_binary(str(folder))


def write_bolls(workspace, labels):
    gaussians = read_gaussians(workspace.gaussians_ply)
    bolls = [
        BollInstance(k, np.flatnonzero(labels == k), ("000000.jpg",), gaussians.means[labels == k].mean(0), 0.1, 0.75)
        for k in range(1, labels.max() + 1)
    ]
    with workspace.writing("cluster") as folder:
        describe_bolls(bolls, gaussians.sha256()).save(folder / "bolls.json")
        np.save(folder / "labels.npy", labels.astype(np.int32))


@pytest.fixture
def workspace(tmp_path):
    """Trained, but no further."""
    (tmp_path / "plant_017").mkdir()
    workspace = Workspace(tmp_path / "plant_017")
    write_cameras(workspace.undistorted / "sparse")
    gaussians, _ = plant_scene()
    # Colours that change with the place, so that views from different sides differ.
    gaussians.sh[:, 0] = np.sin(POSE.cm(gaussians.means) / [25, 15, 30])
    with workspace.writing("train") as folder:
        write_gaussians(folder / "gaussians.ply", gaussians)
    workspace.write_record(Record("train", "ok", options={"max_side": 240}))
    return workspace


@pytest.fixture
def measured(workspace):
    """With bolls, a scale and the plant."""
    write_bolls(workspace, plant_scene()[1])
    table_scale().save(workspace.scale_json)
    train_metrics().save(workspace.metrics_json)
    traits.run(workspace, TraitsOptions())
    return workspace


def distance(first, second):
    """Mean difference in grey levels of 4 x 4 px: a video keeps fewer colours than pixels."""
    small = [cv2.resize(image.astype(np.float32), None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
             for image in (first, second)]  # fmt: skip
    return np.abs(small[0] - small[1]).mean()


def images_of(workspace, options):
    """What `render` saved as images, and its record."""
    record = render(workspace, replace(options, format="png"))
    return [read_image(path) for path in list_images(workspace.root / record["saved_as"])], record


def test_a_video_shows_what_the_camera_of_the_walk_saw(workspace):
    steps = []
    options = replace(SMALL, view="orbit", frames=9, fps=24.0)
    record = render(workspace, options, lambda done, total, remark="": steps.append((done, total)))
    assert steps == [(i + 1, 9) for i in range(9)]
    path = workspace.root / "render" / "orbit_colour" / "orbit_colour.mp4"
    assert workspace.root / record["saved_as"] == path
    facts = probe(path)
    assert (facts.width, facts.height, facts.fps) == (160, 120, 24.0)
    frames = list(read_frames(path, facts, list(range(9)), 160))
    gaussians = read_gaussians(workspace.gaussians_ply)
    path_cameras = [reframe(camera, 160, 120) for camera in walk(read_cameras(workspace.undistorted / "sparse"), 9)]
    direct = [to_uint8(rasterizer.render(gaussians, camera).image) for camera in path_cameras]
    for i, frame in enumerate(frames):
        assert distance(frame, direct[i]) < 4
        assert distance(frame, direct[i - 1]) > 8

    saved = json.loads((path.parent / "render.json").read_text())
    assert saved == record
    assert (saved["frames"], saved["width"], saved["height"]) == (9, 160, 120)
    assert saved["n_gaussians"] == len(gaussians) and saved["fps_rendered"] > 0 and saved["cpu_ms_per_frame"] > 0
    assert saved["threads"] == os.cpu_count() and saved["instruction_set"]


def test_a_turntable_before_anything_is_measured_keeps_the_plant_in_view(workspace):
    images, record = images_of(workspace, replace(SMALL, width=0, height=0))
    # The size of the training images, made even.
    assert (record["width"], record["height"]) == (240, 136)
    assert [image.shape for image in images] == [(136, 240, 3)] * 6
    assert len({image.tobytes() for image in images}) == 6
    # Both formats hold the same frames.
    render(workspace, replace(SMALL, width=0, height=0, background="black"))
    video = workspace.root / "render" / "turntable_colour" / "turntable_colour.mp4"
    frames = read_frames(video, probe(video), list(range(6)), 240)
    assert all(distance(a, b) < 4 for a, b in zip(frames, images, strict=True))


def test_the_plant_alone_turns_in_the_middle(measured):
    images, record = images_of(measured, replace(SMALL, plant_only=True, background="white", frames=8))
    assert record["saved_as"] == "render/turntable_colour_plant"
    assert 100 < record["n_gaussians"] < len(read_gaussians(measured.gaussians_ply))
    # As a whole turn sweeps it; single views of an uneven plant lean to one side.
    frames, lines, columns = np.nonzero((np.stack(images) < 250).any(axis=3))
    assert len(np.unique(frames)) == 8
    assert abs(columns.min() + columns.max() - 159) / 2 < 4
    assert abs(lines.min() + lines.max() - 119) / 2 < 8
    assert np.ptp(lines) == pytest.approx(TOP_CM / 130 * 0.8 * 480 / 270 * 120, rel=0.15)
    assert (images[0][0] == 255).all()


def test_bolls_have_their_colours_and_depth_its_own(measured):
    bolls, _ = images_of(measured, replace(SMALL, show="bolls", width=320, height=240))
    seen = np.concatenate([image.reshape(-1, 3) for image in bolls]) / 255.0
    for colour in boll_colours(np.arange(1, 5, dtype=np.int32)):
        assert (np.abs(seen - colour).max(axis=1) < 0.05).sum() > 30

    depth, record = images_of(measured, replace(SMALL, show="depth", plant_only=True))
    assert record["depth_far_su"] == pytest.approx(3 * record["depth_near_su"])
    distance_cm = (record["depth_near_su"] + record["depth_far_su"]) / 2 * POSE.cm_per_su
    assert distance_cm == pytest.approx(np.hypot(130, 20), rel=0.05)
    for image in depth:
        pixels = image[(image > 30).any(axis=2)]
        # What the camera looks at lies in the middle of the colour map, which is green.
        assert (np.median(pixels, axis=0).argmax()) == 1
    white, _ = images_of(measured, replace(SMALL, show="depth", plant_only=True, background="white"))
    assert (white[0][0] == 255).all() and (depth[0][0] == 0).all()


def test_another_film_leaves_the_first_one_alone(measured):
    for options in (SMALL, replace(SMALL, show="depth"), replace(SMALL, view="orbit", format="jpg")):
        render(measured, options)
    found = sorted(path.relative_to(measured.root).as_posix() for path in (measured.root / "render").glob("*/*"))
    assert [name for name in found if not name.endswith(".cotton3dg")] == [
        *[f"render/orbit_colour/{i:03d}.jpg" for i in range(6)],
        "render/orbit_colour/render.json",
        "render/turntable_colour/render.json",
        "render/turntable_colour/turntable_colour.mp4",
        "render/turntable_depth/render.json",
        "render/turntable_depth/turntable_depth.mp4",
    ]
    render(measured, replace(SMALL, view="orbit", format="png", frames=2))
    assert [path.name for path in list_images(measured.root / "render" / "orbit_colour")] == ["000.png", "001.png"]


def test_the_same_film_twice_has_the_same_bytes(workspace):
    digests = []
    for threads in (1, 2):
        render(workspace, replace(SMALL, format="png", threads=threads))
        digests.append(workspace.hashes(*list_images(workspace.root / "render" / "turntable_colour")))
    assert digests[0] == digests[1] and len(digests[0]) == 6


def test_a_failure_leaves_the_old_film(workspace):
    record = render(workspace, SMALL)
    before = workspace.hashes(workspace.root / "render")

    def interrupt(done, total, remark=""):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(workspace, replace(SMALL, frames=3), interrupt)
    assert workspace.hashes(workspace.root / "render") == before and record["saved_as"] in before


def test_photos_without_an_order_are_passed_in_a_circle(workspace):
    views = orbit(N_VIEWS)
    shuffled = np.random.default_rng(0).permutation(N_VIEWS)
    model = pycolmap.Reconstruction(str(workspace.undistorted / "sparse"))
    for image_id, place in enumerate(shuffled, 1):
        pose = pycolmap.Rigid3d(views[place].cam_from_scene)
        model.frames[model.images[image_id].frame_id].set_cam_from_world(1, pose)
    model.write_binary(str(workspace.undistorted / "sparse"))
    frames_info([], ordered=False).save(workspace.frames_json)
    away = [
        [np.abs(view.cam_from_scene - camera.cam_from_scene).max() for view in views]
        for camera in _order_cameras(workspace)
    ]
    # Once around from the first photo, one way or the other.
    places = np.argmin(away, axis=1)
    assert places[0] == shuffled[0]
    assert set(np.diff(places) % N_VIEWS) in ({1}, {N_VIEWS - 1})
    assert len(images_of(workspace, replace(SMALL, view="orbit", frames=5))[0]) == 5


def test_what_is_missing_is_named(workspace, tmp_path):
    with pytest.raises(MissingInput, match="cotton3dg cluster"):
        render(workspace, replace(SMALL, show="bolls"))
    with pytest.raises(MissingInput, match="cotton3dg traits"):
        render(workspace, replace(SMALL, plant_only=True))
    with pytest.raises(BadUsage, match="even numbers"):
        render(workspace, replace(SMALL, width=161))
    assert not (workspace.root / "render").exists()
    images, _ = images_of(workspace, replace(SMALL, width=161, frames=1))
    assert images[0].shape == (120, 161, 3)
    write_bolls(workspace, np.zeros(len(read_gaussians(workspace.gaussians_ply)), int))
    with pytest.raises(NoBolls, match="no bolls"):
        render(workspace, replace(SMALL, show="bolls"))


def test_bolls_and_plant_of_another_model_are_refused(measured):
    gaussians = read_gaussians(measured.gaussians_ply)
    write_gaussians(measured.gaussians_ply, gaussians[np.arange(len(gaussians))[::-1]])
    measured.write_record(Record("traits", inputs={"train/gaussians.ply": "of before"}))
    with pytest.raises(BadInput, match="cotton3dg cluster"):
        render(measured, replace(SMALL, show="bolls"))
    with pytest.raises(BadInput, match="cotton3dg traits"):
        render(measured, replace(SMALL, plant_only=True))
    render(measured, replace(SMALL, frames=1))
    np.save(measured.plant_npy, np.zeros(len(gaussians), bool))
    measured.write_record(Record("traits"))
    with pytest.raises(BadInput, match="without --plant-only"):
        render(measured, replace(SMALL, plant_only=True))
    measured.plant_npy.write_bytes(b"\x93NUMPY")
    with pytest.raises(BadInput, match="damaged"):
        render(measured, replace(SMALL, plant_only=True))


def test_somebody_elses_files_are_not_replaced(workspace):
    (workspace.root / "render").write_text("a user's")
    with pytest.raises(BadInput, match="render is a file"):
        render(workspace, SMALL)
    (workspace.root / "render").unlink()
    (workspace.root / "render" / "turntable_colour").mkdir(parents=True)
    with pytest.raises(BadInput, match="not made by it"):
        render(workspace, SMALL)


def test_the_command_prints_one_line_with_a_remedy_or_the_speed(workspace):
    def run(*arguments):
        command = [sys.executable, "-m", "cotton3dg.cli", "render", workspace.root, *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)

    done = run("--frames", "2", "--width", "64", "--height", "48", "--format", "png")
    assert done.returncode == 0, done.stderr
    assert "2 frames of 64x48 px" in done.stdout and "a second on" in done.stdout
    assert str(workspace.root / "render" / "turntable_colour") in done.stdout
    wrong = run("--show", "beauty")
    assert wrong.returncode == 2 and "colour, bolls, depth" in wrong.stderr
    workspace.gaussians_ply.unlink()
    untrained = run()
    assert untrained.returncode == 2 and "Traceback" not in untrained.stderr
    assert untrained.stderr.splitlines()[-1].startswith("plant_017: ")
    assert "run `cotton3dg train` first" in untrained.stderr.splitlines()[-1]
