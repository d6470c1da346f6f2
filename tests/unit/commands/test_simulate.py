# SPDX-License-Identifier: Apache-2.0
"""What simulate films and writes: bare rooms, a turntable, things on the table, light from one side."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scenes.simulated_plant import SMALL, TINY, small_plant

from cotton3dg.choices import read_toml
from cotton3dg.commands.simulate import _stage, simulate
from cotton3dg.core.scene import Camera
from cotton3dg.errors import BadUsage
from cotton3dg.io.images import read_ids
from cotton3dg.options import resolve
from cotton3dg.simulate.camera import orbit
from cotton3dg.simulate.camera_effects import film, film_ids
from cotton3dg.simulate.plant import grow_plant
from cotton3dg.simulate.render import light_scene
from cotton3dg.simulate.room import build_room


def test_a_white_room_is_bare_and_a_pale_table_is_pale() -> None:
    plant = small_plant()
    pictures = {}
    for name in ("white_room", "pale_table", "seed"):
        options = replace(TINY, **({} if name == "seed" else {name: True}))
        path = orbit(options, plant.vertices)
        scene, behind = _stage(plant, path, options)
        assert behind is None
        pictures[name] = film(scene, path, 0, options).astype(float)
    assert (
        np.abs(np.diff(pictures["white_room"][:30, :40], axis=1)).mean()
        < 0.4 * np.abs(np.diff(pictures["seed"][:30, :40], axis=1)).mean()
    )
    assert pictures["pale_table"][60:, 40:90].mean() > pictures["seed"][60:, 40:90].mean() + 20


def test_before_a_still_camera_only_the_plant_turns() -> None:
    plant = small_plant()
    options = replace(TINY, turntable=True)
    path = orbit(options, plant.vertices)
    scene, behind = _stage(plant, path, options)
    pictures = np.stack([film(scene, path, frame, options, behind) for frame in (0, 6, 12)]).astype(int)
    still = (np.abs(pictures - pictures[0]).max(axis=(0, 3))) == 0
    assert 0.6 < still.mean() < 0.98
    assert still[:, :20].all()
    assert still[:, -20:].all()


def test_things_are_seen_and_are_no_bolls() -> None:
    plant = small_plant()
    shown = {}
    for things in (0, 8):
        options = replace(TINY, things=things)
        path = orbit(options, plant.vertices)
        scene, _ = _stage(plant, path, options)
        shown[things] = film(scene, path, 0, options).astype(int), film_ids(scene, path, 0, options)
    changed = np.abs(shown[8][0] - shown[0][0]).max(axis=2) > 20
    assert changed[45:].mean() > 0.02
    assert (shown[8][1] > 0).any()
    # A thing may hide lint, and shows none.
    assert not ((shown[8][1] > 0) & (shown[0][1] == 0)).any()


def test_beside_a_turning_plant_things_stand_still() -> None:
    plant = small_plant()
    options = replace(TINY, turntable=True, things=8)
    path = orbit(options, plant.vertices)
    scene, behind = _stage(plant, path, options)
    bare, empty = _stage(plant, path, replace(TINY, turntable=True))
    assert behind is not None
    assert empty is not None
    assert (np.abs(behind - empty).max(axis=2) > 0.05).mean() > 0.01
    assert (scene.rays.cast(*rays_of(path)).meshes == bare.rays.cast(*rays_of(path)).meshes).all()


def rays_of(path):
    camera = path.at(0)
    y, x = np.mgrid[:72, :128].reshape(2, -1) + 0.5
    towards = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones(x.size)], axis=1)
    directions = (towards @ camera.rotation).astype(np.float32)
    return np.tile(camera.centre.astype(np.float32), (x.size, 1)), directions


def test_light_from_one_side_leaves_the_other_in_the_dark() -> None:
    """Lint around the plant as cameras see it: with one window, one side of it is much darker than the other."""
    plant = small_plant()
    spans = {}
    for one_sided in (False, True):
        options = replace(TINY, one_sided=one_sided)
        path = orbit(options, plant.vertices)
        scene, _ = _stage(plant, path, options)
        assert len(build_room(options, plant.stem_base).lamps) == (1 if one_sided else 3)
        views = []
        for frame in range(0, 24, 4):
            lint = film_ids(scene, path, frame, options) > 0
            views.append(film(scene, path, frame, options)[lint].mean())
        spans[one_sided] = max(views) / min(views)
    assert spans[True] > 1.4
    assert spans[False] < 0.85 * spans[True]


def test_simulate_writes_video_and_truth(tmp_path):
    options = replace(SMALL, frames=9, mask_interval=4, noise=2.0)
    folder = simulate(tmp_path / "plant", options)
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    masks = [f"instances/frame_{frame:04d}.png" for frame in (0, 4, 8)]
    assert names == ["cameras.json", "cotton3dg.toml", *masks, "instances/frames.json", "truth.json", "video.mp4"]
    size = resolve("scale", read_toml(folder / "cotton3dg.toml")["scale"])
    assert (size.table_cm, size.table_is_assumed) == ((120.0, 60.0), False)

    video = cv2.VideoCapture(str(folder / "video.mp4"))
    images = []
    while (image := video.read()[1]) is not None:
        images.append(image[..., ::-1])
    assert len(images) == 9
    assert images[0].shape == (108, 192, 3)
    plant = grow_plant(options)
    scene, path = light_scene(plant, build_room(options, plant.stem_base)), orbit(options, plant.vertices)
    for frame in (0, 5):
        difference = images[frame].astype(float) - film(scene, path, frame, options)
        assert 10 * np.log10(255**2 / (difference**2).mean()) > 28

    cameras = json.loads((folder / "cameras.json").read_text())
    truth = json.loads((folder / "truth.json").read_text())
    frames = json.loads((folder / "instances" / "frames.json").read_text())["frames"]
    assert frames == {f"frame_{frame:04d}.png": frame for frame in (0, 4, 8)}
    largest = np.zeros(5, int)
    for name, frame in frames.items():
        ids = read_ids(folder / "instances" / name)
        largest = np.maximum(largest, np.bincount(ids.ravel(), minlength=5))
        pose = np.linalg.inv(cameras["frames"][frame]["camera_to_world"])[:3]
        lens = {key: cameras[key] for key in ("width", "height", "fx", "fy", "cx", "cy")}
        camera = Camera(name=name, cam_from_scene=pose, **lens)
        for record in truth["bolls"]:
            rows, columns = np.nonzero(ids == record["id"])
            pixel = camera.project(np.array([record["centre_xyz_m"]]))[0][0]
            if len(rows) > 20:
                assert np.hypot(columns.mean() + 0.5 - pixel[0], rows.mean() + 0.5 - pixel[1]) < 5
    assert [record["visible_pixel_max"] for record in truth["bolls"]] == largest[1:].tolist()
    assert len(cameras["frames"]) == 9

    simulate(folder, replace(options, frames=3))
    assert sorted(path.name for path in (folder / "instances").iterdir()) == ["frame_0000.png", "frames.json"]


def test_simulate_never_replaces_what_it_did_not_write(tmp_path):
    (tmp_path / "video.mp4").write_bytes(b"a user's video")
    with pytest.raises(BadUsage, match="not made by simulate"):
        simulate(tmp_path, SMALL)
    with pytest.raises(BadUsage, match="even"):
        simulate(tmp_path / "new", replace(SMALL, width=101))
    assert (tmp_path / "video.mp4").read_bytes() == b"a user's video"


def test_a_card_needs_an_id(tmp_path):
    with pytest.raises(BadUsage, match="not an id"):
        simulate(tmp_path / "new", replace(SMALL, card=" "))
