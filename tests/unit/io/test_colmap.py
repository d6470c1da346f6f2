# SPDX-License-Identifier: Apache-2.0
"""COLMAP models: read as COLMAP itself reads them, and damaged files refused."""

import struct

import numpy as np
import pycolmap
import pytest

from cotton3dg.core.scene import Camera
from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.io import exports
from cotton3dg.io.colmap import read_cameras, read_points, read_positions


@pytest.fixture(scope="module")
def model():
    """Five pinhole cameras and 80 points, made by COLMAP."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig, options.num_points3D = 1, 1, 5, 80
    options.camera_model_id = pycolmap.CameraModelId.PINHOLE
    options.camera_params = [900.0, 910.0, 512.0, 380.0]
    pycolmap.set_random_seed(3)
    return pycolmap.synthesize_dataset(options)


@pytest.fixture
def folder(model, tmp_path):
    model.write_binary(tmp_path)
    return tmp_path


def test_cameras_project_as_colmap_does(model, folder):
    cameras = read_cameras(folder)
    images = {image.name.replace("/", "_"): image for image in model.images.values()}
    assert [camera.name for camera in cameras] == sorted(images)
    points = np.array([point.xyz for point in model.points3D.values()])
    for camera in cameras:
        pixels, depths = camera.project(points)
        assert (depths > 0).any()
        for pixel, depth, point in zip(pixels, depths, points, strict=True):
            if depth > 0:
                np.testing.assert_allclose(images[camera.name].project_point(point), pixel, rtol=1e-9)


def test_points_are_those_of_colmap(model, folder):
    xyz, rgb, errors, lengths = read_points(folder)
    expected = [model.point3D(key) for key in sorted(model.point3D_ids())]
    np.testing.assert_array_equal(xyz, [point.xyz for point in expected])
    np.testing.assert_array_equal(rgb, [point.color for point in expected])
    np.testing.assert_array_equal(lengths, [point.track.length() for point in expected])
    assert errors.shape == (80,) and np.isfinite(errors).all()
    ids, places = read_positions(folder)
    assert ids.tolist() == sorted(model.point3D_ids())
    np.testing.assert_array_equal(places, xyz)


def camera_file(*cameras):
    return struct.pack("<Q", len(cameras)) + b"".join(cameras)


def pinhole(camera_id=1, width=640, height=480, values=(500.0, 500.0, 320.0, 240.0), model=1):
    return struct.pack("<iiQQ", camera_id, model, width, height) + struct.pack(f"<{len(values)}d", *values)


def image_file(*images):
    return struct.pack("<Q", len(images)) + b"".join(images)


def image(name=b"a.jpg", pose=(1.0, 0, 0, 0, 0, 0, 0), camera_id=1, n_points=0, points=b""):
    return struct.pack("<I7dI", 1, *pose, camera_id) + name + b"\0" + struct.pack("<Q", n_points) + points


def write_model(folder, cameras, images):
    (folder / "cameras.bin").write_bytes(cameras)
    (folder / "images.bin").write_bytes(images)
    return folder


def test_image_without_finite_pose_is_left_out_with_a_warning(tmp_path, caplog):
    lost = image(b"b.jpg", (float("nan"),) * 7)
    unturned = image(b"c.jpg", (0.0,) * 7)
    write_model(tmp_path, camera_file(pinhole()), image_file(image(), lost, unturned))
    assert [camera.name for camera in read_cameras(tmp_path)] == ["a.jpg"]
    assert "b.jpg" in caplog.text and "c.jpg" in caplog.text


def test_no_pose_at_all_is_an_error(tmp_path):
    write_model(tmp_path, camera_file(pinhole()), image_file(image(pose=(float("inf"),) * 7)))
    with pytest.raises(BadInput, match="no image with a pose"):
        read_cameras(tmp_path)


@pytest.mark.parametrize(
    "camera",
    [
        pinhole(values=(float("nan"), 500.0, 320.0, 240.0)),
        pinhole(values=(-500.0, 500.0, 320.0, 240.0)),
        pinhole(width=0),
        pinhole(width=2**40),
        pinhole(model=2),
        pinhole(model=-7),
        pinhole(camera_id=9),
    ],
)
def test_impossible_cameras_are_refused(tmp_path, camera):
    write_model(tmp_path, camera_file(camera), image_file(image()))
    with pytest.raises(BadInput):
        read_cameras(tmp_path)


@pytest.mark.parametrize(
    "picture",
    [
        image(name=b"../../etc/passwd"),
        image(name=b""),
        image(name=b"\xff\xfe"),
        image(n_points=2**60),
        image(n_points=5, points=bytes(48)),
        image()[:-9],
    ],
)
def test_hostile_images_are_refused(tmp_path, picture):
    write_model(tmp_path, camera_file(pinhole()), image_file(picture))
    with pytest.raises(BadInput):
        read_cameras(tmp_path)


def test_counts_beyond_the_file_are_refused_before_allocation(tmp_path):
    (tmp_path / "points3D.bin").write_bytes(struct.pack("<Q", 2**62))
    with pytest.raises(BadInput, match="claims"):
        read_points(tmp_path)


def test_every_truncation_is_refused_or_read(folder):
    """No length of any of the files leads to another exception."""
    for name, read in (("cameras.bin", read_cameras), ("images.bin", read_cameras), ("points3D.bin", read_points)):
        whole = (folder / name).read_bytes()
        for length in [*range(min(200, len(whole))), len(whole) // 2, len(whole) - 1]:
            (folder / name).write_bytes(whole[:length])
            with pytest.raises(BadInput):
                read(folder)
        (folder / name).write_bytes(whole)


def test_random_damage_is_refused_or_leaves_what_can_be_used(folder):
    rng = np.random.default_rng(0)
    ends = {"refused": 0, "read": 0}
    for name, read in (("cameras.bin", read_cameras), ("images.bin", read_cameras), ("points3D.bin", read_points)):
        whole = (folder / name).read_bytes()
        for _ in range(150):
            damaged = bytearray(whole)
            for at in rng.integers(0, min(len(whole), 400), 4):
                damaged[at] = rng.integers(256)
            (folder / name).write_bytes(damaged)
            try:
                found = read(folder)
            except BadInput:
                ends["refused"] += 1
                continue
            ends["read"] += 1
            numbers = [c.cam_from_scene for c in found] if read is read_cameras else [found[0]]
            assert all(np.isfinite(array).all() for array in numbers)
            assert read is read_points or all(c.fx > 0 and c.fy > 0 and c.width > 0 and c.height > 0 for c in found)
        (folder / name).write_bytes(whole)
    assert min(ends.values()) > 30


def test_points_that_are_not_finite_are_left_out(tmp_path):
    def point(key, x, error=0.5):
        return struct.pack("<Q3d3BdQ", key, x, 2.0, 3.0, 10, 20, 30, error, 1) + bytes(8)

    points = [point(7, 1.0, float("nan")), point(5, float("nan")), point(2, 4.0)]
    (tmp_path / "points3D.bin").write_bytes(struct.pack("<Q", 3) + b"".join(points))
    xyz, _, errors, lengths = read_points(tmp_path)
    assert xyz[:, 0].tolist() == [4.0, 1.0]
    assert errors.tolist() == [0.5, -1.0] and lengths.tolist() == [1, 1]


def test_missing_model_names_the_stage(tmp_path):
    with pytest.raises(MissingInput, match="cotton3dg sfm"):
        read_cameras(tmp_path)


@pytest.fixture
def camera():
    """At (1, 2, 3), looking along +x of the scene with the scene's z up."""
    cam_from_scene_rotation = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    translation = -cam_from_scene_rotation @ [1.0, 2, 3]
    return Camera(
        "a.jpg", 640, 480, 500.0, 510.0, 320.0, 240.0, np.hstack([cam_from_scene_rotation, translation[:, None]])
    )


def test_nerfstudio_axes(camera):
    frame = exports.nerfstudio_transforms([camera], "images")["frames"][0]
    pose = np.array(frame["transform_matrix"])
    np.testing.assert_allclose(pose[:3, 0], (0, -1, 0), atol=1e-12)  # right
    np.testing.assert_allclose(pose[:3, 1], (0, 0, 1), atol=1e-12)  # up
    np.testing.assert_allclose(pose[:3, 2], (-1, 0, 0), atol=1e-12)  # backward
    np.testing.assert_allclose(pose[:, 3], (1, 2, 3, 1))
    assert (frame["file_path"], frame["fl_y"]) == ("images/a.jpg", 510.0)


def test_llff_axes_and_depths(camera):
    points = np.array([[3.0, 2, 3], [6.0, 2, 3], [-5.0, 2, 3], [2.0, 100, 3]])  # two in view, one behind, one aside
    (row,) = exports.llff_poses_bounds([camera], points)
    matrix = row[:15].reshape(3, 5)
    np.testing.assert_allclose(matrix[:, 0], (0, 0, -1), atol=1e-12)  # down
    np.testing.assert_allclose(matrix[:, 1], (0, -1, 0), atol=1e-12)  # right
    np.testing.assert_allclose(matrix[:, 2], (-1, 0, 0), atol=1e-12)  # backward
    np.testing.assert_allclose(matrix[:, 3], (1, 2, 3))
    assert matrix[:, 4].tolist() == [480, 640, 505]
    np.testing.assert_allclose(row[15:], (2, 5), atol=0.01)
