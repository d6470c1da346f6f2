# SPDX-License-Identifier: Apache-2.0
"""What a run leaves is read by other programs' own readers, and says the same there (docs/exports.md)."""

import json
import subprocess

import cv2
import numpy as np
import pytest

from cotton3dg.io.colmap import read_cameras, read_points
from cotton3dg.io.ply import read_gaussians


@pytest.fixture(scope="module")
def plant(first_run):
    return first_run[0]


def test_open3d_reads_the_gaussians(plant):
    import open3d as o3d

    for path in (plant.gaussians_ply, plant.bolls_ply):
        ours = read_gaussians(path)
        points = np.asarray(o3d.io.read_point_cloud(str(path)).points)
        np.testing.assert_array_equal(points, ours.means)
        # Open3D knows the layout as that of Gaussians by its property names.
        table = o3d.t.io.read_point_cloud(str(path)).point
        for name, values in (
            ("opacity", ours.opacity_logits[:, None]),
            ("scale", ours.scales),
            ("rot", ours.quats),
            ("f_dc", ours.sh[:, 0]),
            *([("f_rest", ours.sh[:, 1:])] if ours.sh_degree else []),
        ):
            np.testing.assert_allclose(table[name].numpy(), values, rtol=1e-5)


def test_labels_belong_to_the_rows(plant):
    labels = np.load(plant.labels_npy, allow_pickle=False)
    assert len(labels) == len(read_gaussians(plant.gaussians_ply)) == len(read_gaussians(plant.bolls_ply))


def test_colmap_and_nerfstudio_see_the_same_cameras(plant):
    import pycolmap

    model = pycolmap.Reconstruction(plant.undistorted / "sparse")
    transforms = json.loads((plant.sfm_model / "transforms.json").read_text())
    points = read_points(plant.undistorted / "sparse")[0]
    points = points[:: max(1, len(points) // 200)]  # from everywhere: each camera sees some
    frames = {frame["file_path"].rsplit("/", 1)[1]: frame for frame in transforms["frames"]}
    ours = {camera.name: camera for camera in read_cameras(plant.undistorted / "sparse")}
    assert set(frames) == {image.name for image in model.images.values()} == set(ours)
    for image in model.images.values():
        expected, depths = ours[image.name].project(points)
        points_ahead, expected = points[depths > 0], expected[depths > 0]
        colmap = [image.project_point(point) for point in points_ahead]
        np.testing.assert_allclose(colmap, expected, atol=1e-3)
        # nerfstudio's cameras look along -z with y up.
        frame = frames[image.name]
        cam_from_scene = np.linalg.inv(frame["transform_matrix"])
        x, y, z = (points_ahead @ cam_from_scene[:3, :3].T + cam_from_scene[:3, 3]).T
        pixels = np.stack([frame["cx"] + frame["fl_x"] * x / -z, frame["cy"] - frame["fl_y"] * y / -z], axis=1)
        np.testing.assert_allclose(pixels, expected, atol=1e-3)
        assert (plant.sfm_model / frame["file_path"]).is_file()


def test_llff_poses_have_a_row_an_image(plant):
    poses = np.load(plant.sfm_model / "poses_bounds.npy", allow_pickle=False)
    assert poses.shape == (len(read_cameras(plant.undistorted / "sparse")), 17)
    assert (poses[:, 15] > 0).all() and (poses[:, 15] < poses[:, 16]).all()


def test_masks_are_plain_16_bit_pictures(plant):
    pictures = sorted(plant.folder("masks").glob("*.png"))
    assert len(pictures) == 16
    ids = cv2.imread(str(pictures[0]), cv2.IMREAD_UNCHANGED)
    assert ids.dtype == np.uint16 and ids.ndim == 2 and ids.max() > 0


def test_the_film_is_h264(tiny_plant):
    from cotton3dg.commands.render import render
    from cotton3dg.io.video import ffmpeg_binary
    from cotton3dg.options import resolve

    render(tiny_plant, resolve("render", {"frames": 4}))
    (film,) = (tiny_plant.root / "render").rglob("*.mp4")
    told = subprocess.run([ffmpeg_binary(), "-i", film], capture_output=True, text=True, check=False).stderr
    assert "Video: h264" in told and "yuv420p" in told
