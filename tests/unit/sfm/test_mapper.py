# SPDX-License-Identifier: Apache-2.0
"""The database that COLMAP starts from, and the last adjustment of cameras and points."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from cotton3dg.io.images import write_image
from cotton3dg.sfm.mapper import CAMERA_MODEL, bundle_adjust, write_database


@pytest.fixture
def seen() -> tuple[np.ndarray, pycolmap.Reconstruction]:
    """True centres of 12 cameras, and their model with noise and a tenth of the observations wrong."""
    pycolmap.set_random_seed(3)
    what = pycolmap.SyntheticDatasetOptions()
    what.num_rigs, what.num_frames_per_rig, what.num_points3D = 1, 12, 300
    model = pycolmap.synthesize_dataset(what)
    true = _centres(model)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev, noise.point3D_stddev, noise.rig_from_world_translation_stddev = 0.3, 0.01, 0.01
    pycolmap.synthesize_noise(noise, model)
    rng = np.random.default_rng(3)
    for image_id in model.reg_image_ids():
        image = model.image(image_id)
        for index in rng.choice(len(image.points2D), len(image.points2D) // 10, replace=False):
            image.points2D[int(index)].xy += [3.0, 1.0]
    return true, model


def test_settling_leaves_out_what_is_far_off(seen: tuple[np.ndarray, pycolmap.Reconstruction]) -> None:
    true, model = seen
    plain = pycolmap.Reconstruction(model)
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    pycolmap.bundle_adjustment(plain, options)
    settled = pycolmap.Reconstruction(plain)
    bundle_adjust(settled)
    assert _rms(settled, true) < 0.75 * _rms(plain, true)
    assert settled.compute_num_observations() < plain.compute_num_observations()


def test_settling_a_model_without_points_changes_nothing() -> None:
    model = pycolmap.Reconstruction()
    bundle_adjust(model)
    assert model.num_points3D() == 0


@pytest.mark.parametrize("focal_length_px", [None, 300.0])
def test_the_database_is_that_of_colmaps_own_import(tmp_path: Path, focal_length_px: float | None) -> None:
    names = [f"{number}.jpg" for number in range(3)]
    for number, name in enumerate(names):
        write_image(tmp_path / name, np.full((48, 64, 3), 50 * number, np.uint8))
    write_database(tmp_path / "ours.db", tmp_path, names, {}, {}, focal_length_px)
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = CAMERA_MODEL
    pycolmap.Database.open(tmp_path / "theirs.db").close()
    pycolmap.import_images(tmp_path / "theirs.db", tmp_path, pycolmap.CameraMode.SINGLE, names, reader)
    if focal_length_px:
        with pycolmap.Database.open(tmp_path / "theirs.db") as database:
            (camera,) = database.read_all_cameras()
            camera.focal_length, camera.has_prior_focal_length = focal_length_px, True
            database.update_camera(camera)
    assert _tables(tmp_path / "ours.db") == _tables(tmp_path / "theirs.db")


def _tables(database: Path) -> dict[str, list[tuple]]:
    with closing(sqlite3.connect(database)) as opened:
        names = [name for (name,) in opened.execute("select name from sqlite_master where type = 'table'")]
        return {name: opened.execute(f"select * from {name}").fetchall() for name in names}


def _centres(model: pycolmap.Reconstruction) -> np.ndarray:
    return np.array([model.image(i).projection_center() for i in sorted(model.reg_image_ids())])


def _rms(model: pycolmap.Reconstruction, true: np.ndarray) -> float:
    """Of the centres' distances from the true ones, after the best similarity."""
    centres = _centres(model)
    best = pycolmap.estimate_sim3d(centres, true)
    return float(np.sqrt(np.mean(np.sum((best * centres - true) ** 2, axis=1))))
