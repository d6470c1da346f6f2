# SPDX-License-Identifier: Apache-2.0
"""The traits stage on a made plant: files of the stages before in, tables out."""

import csv
import json

import numpy as np
import pytest
from scenes.documents import sfm_info, table_scale, train_metrics
from scenes.table_scene import BOLL_RADIUS_CM, BOLLS_CM, FOOT_CM, POSE, orbit, plant_scene
from scipy.spatial.transform import Rotation

from cotton3dg.core.bolls import BollInstance
from cotton3dg.errors import BadInput, BadUsage, MissingInput
from cotton3dg.io.images import write_image
from cotton3dg.io.ply import read_gaussians, write_gaussians
from cotton3dg.io.tables import BOLLS, BRANCHES, TRAITS
from cotton3dg.options import TraitsOptions
from cotton3dg.plant_map.thin_twigs import Trail
from cotton3dg.schemas.bolls import describe_bolls
from cotton3dg.schemas.masks import MasksInfo
from cotton3dg.schemas.record import Record
from cotton3dg.schemas.scale import ScaleInfo
from cotton3dg.traits import stage as traits
from cotton3dg.traits.count_distribution import HULL_OF_TWO
from cotton3dg.traits.error_model import SHAPE
from cotton3dg.workspace import Workspace

BOLL_CM3 = 4 / 3 * np.pi * BOLL_RADIUS_CM**3


def write_bolls(workspace, labels):
    gaussians = read_gaussians(workspace.gaussians_ply)
    bolls = [
        BollInstance(k, np.flatnonzero(labels == k), ("000000.jpg",) * k, gaussians.means[labels == k].mean(0), 0.1,
                     0.75, ("split",) if k == 2 else ())
        for k in range(1, labels.max() + 1)
    ]  # fmt: skip
    describe_bolls(bolls, gaussians.sha256()).save(workspace.bolls_json)
    np.save(workspace.labels_npy, labels.astype(np.int32))


@pytest.fixture
def workspace(tmp_path):
    folder = tmp_path / "plant_017"
    folder.mkdir()
    workspace = Workspace(folder)
    gaussians, labels = plant_scene()
    workspace.gaussians_ply.parent.mkdir()
    write_gaussians(workspace.gaussians_ply, gaussians)
    write_bolls(workspace, labels)
    table_scale().save(workspace.scale_json)
    names = [f"{k}" for k in range(100)]
    sfm_info(names, tuple(names[93:])).save(workspace.sfm_json)
    train_metrics(psnr_db=31.4159).save(workspace.metrics_json)
    workspace.write_record(Record("sfm", "ok", seconds=100.25, flags=("few_frames_registered",)))
    workspace.write_record(Record("train", "ok", seconds=200.5, flags=("low_psnr", "few_frames_registered")))
    return workspace


def rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_plant_has_its_row(workspace):
    outcome = traits.run(workspace, TraitsOptions())
    (row,) = rows(workspace.traits_csv)
    assert list(row) == [column.name for column in TRAITS]
    assert row["plant_id"] == "plant_017"
    assert row["boll_count"] == "4"
    assert float(row["boll_volume_cm3"]) == pytest.approx(4 * BOLL_CM3, rel=0.05)
    assert float(row["boll_volume_mean_cm3"]) == pytest.approx(BOLL_CM3, rel=0.05)
    assert float(row["plant_height_cm"]) == pytest.approx(70.0, abs=0.3)
    assert float(row["canopy_size_cm"]) == pytest.approx(
        (float(row["canopy_length_cm"]) + float(row["canopy_width_cm"])) / 2, abs=0.011
    )
    assert (row["scale_source"], row["scale_error_pct"]) == ("table", "0.200")
    assert (row["n_frames"], row["registered_pct"], row["psnr_db"]) == ("100", "93.0", "31.42")
    assert row["seconds"] == "300.8"
    assert row["qc_flags"] == "few_frames_registered|low_psnr|doubtful_bolls"
    assert row["version"]
    heights = BOLLS_CM[:, 2]
    assert float(row["boll_height_mean_cm"]) == pytest.approx(heights.mean(), abs=0.3)
    assert float(row["boll_height_sd_cm"]) == pytest.approx(heights.std(ddof=1), abs=0.3)
    assert float(row["boll_height_min_cm"]) == pytest.approx(heights.min(), abs=0.3)
    assert float(row["boll_height_max_cm"]) == pytest.approx(heights.max(), abs=0.3)
    assert [row[f"bolls_{third}"] for third in ("lower", "middle", "upper")] == ["0", "2", "2"]
    # The shadow of a ball is a disc.
    assert float(row["lint_area_cm2"]) == pytest.approx(4 * np.pi * BOLL_RADIUS_CM**2, rel=0.05)
    assert 3000 < float(row["plant_hull_volume_cm3"]) < 70 * 34 * 25
    # Scale 0.2 %, and a pixel of 0.0037 cm.
    assert float(row["plant_height_error_cm"]) == pytest.approx(0.14, abs=0.011)
    # The scale's error is all bolls', that of the shape, which is nearly a ball's, each one's own.
    of_bolls = [(float(boll["volume_cm3"]), float(boll["diameter_cm"])) for boll in rows(workspace.bolls_csv)]
    own = [SHAPE * (volume - np.pi / 6 * diameter**3) for volume, diameter in of_bolls]
    # Each is one boll with a probability of 0.75 only; the others are all two, or all parts, as likely as not. So the
    # sum is expected to be too large, by a share that the bolls have in common, and each boll for itself.
    of_two = HULL_OF_TWO * np.array([volume for volume, _ in of_bolls])
    wrong = [0.125 * of_two.sum(), 0.125 * of_two.sum(), *np.sqrt(0.5 * 0.25 * 0.75) * of_two]
    volume_error_cm3 = np.linalg.norm([0.006 * sum(volume for volume, _ in of_bolls), *own, *wrong])
    assert float(row["boll_volume_error_cm3"]) == pytest.approx(volume_error_cm3, rel=0.15)
    assert float(row["boll_count_error"]) == pytest.approx(np.sqrt((1.75 + 0.6875) / 2), abs=0.1)
    assert outcome.summary["boll_count"] == 4


def test_each_boll_has_its_row_in_the_plant_frame(workspace):
    traits.run(workspace, TraitsOptions())
    bolls = rows(workspace.bolls_csv)
    assert list(bolls[0]) == [column.name for column in BOLLS]
    assert [row["boll_id"] for row in bolls] == ["1", "2", "3", "4"]
    for row, centre in zip(bolls, BOLLS_CM, strict=True):
        assert [float(row[f"{axis}_cm"]) for axis in "xyz"] == pytest.approx(centre - FOOT_CM, abs=0.4)
        assert float(row["volume_cm3"]) == pytest.approx(BOLL_CM3, rel=0.05)
        assert float(row["diameter_cm"]) == pytest.approx(2 * BOLL_RADIUS_CM, rel=0.02)
        assert row["n_gaussians"] == "400"
        assert row["n_views"] == row["boll_id"]
        assert row["confidence"] == "0.750"
    assert [row["qc_flags"] for row in bolls] == ["", "split", "", ""]


def test_a_spreadsheet_that_splits_at_semicolons_finds_none(workspace):
    traits.run(workspace, TraitsOptions())
    for table in (workspace.traits_csv, workspace.bolls_csv, workspace.branches_csv):
        assert ";" not in table.read_text()
    assert "|" in rows(workspace.traits_csv)[0]["qc_flags"]


def test_columns_are_described_beside_the_tables(workspace):
    traits.run(workspace, TraitsOptions())
    described = rows(workspace.traits_csv.with_name("columns.csv"))
    assert [(row["table"], row["column"]) for row in described] == [
        *(("traits.csv", column.name) for column in TRAITS),
        *(("bolls.csv", column.name) for column in BOLLS),
        *(("branches.csv", column.name) for column in BRANCHES),
    ]


def test_without_a_scale_metric_cells_are_blank(workspace):
    ScaleInfo("none", "no table").save(workspace.scale_json)
    traits.run(workspace, TraitsOptions())
    (row,) = rows(workspace.traits_csv)
    assert row["boll_count"] == "4"
    assert row["scale_source"] == "none"
    assert row["scale_error_pct"] == ""
    assert {row[column.name] for column in TRAITS if column.unit in ("cm", "cm2", "cm3")} == {""}
    assert (row["bolls_lower"], row["bolls_upper"]) == ("", "")
    for boll in rows(workspace.bolls_csv):
        assert {boll[column.name] for column in BOLLS if column.name.endswith(("_cm", "_cm3"))} == {""}
        assert boll["n_gaussians"] == "400"


def test_a_plant_without_bolls_has_none(workspace):
    write_bolls(workspace, np.zeros(len(read_gaussians(workspace.gaussians_ply)), int))
    traits.run(workspace, TraitsOptions())
    (row,) = rows(workspace.traits_csv)
    assert (row["boll_count"], row["boll_volume_cm3"], row["boll_volume_mean_cm3"]) == ("0", "", "")
    assert float(row["plant_height_cm"]) > 50
    assert rows(workspace.bolls_csv) == []


def test_a_plant_may_have_another_name_and_a_byte_order_mark(workspace):
    traits.run(workspace, TraitsOptions(plant_id="=A1", excel=True))
    assert workspace.traits_csv.read_bytes().startswith(b"\xef\xbb\xbfplant_id,")
    with workspace.traits_csv.open(newline="", encoding="utf-8-sig") as file:
        assert next(csv.DictReader(file))["plant_id"] == "'=A1"


def test_bolls_of_another_model_are_refused(workspace):
    table = json.loads(workspace.bolls_json.read_text())
    workspace.bolls_json.write_text(json.dumps(table | {"gaussians_sha256": "0" * 64}))
    with pytest.raises(BadInput, match="cotton3dg cluster"):
        traits.run(workspace, TraitsOptions())


def test_masks_of_a_back_end_that_is_gone_are_refused(workspace):
    workspace.masks_json.parent.mkdir()
    MasksInfo("lint", {"backend": "lint"}, {}, 0.0, ()).save(workspace.masks_json)
    with pytest.raises(BadUsage, match="'lint' is gone; use bolls; run `cotton3dg masks` again"):
        traits.run(workspace, TraitsOptions())
    assert not workspace.traits_csv.exists()


def test_a_model_without_the_size_of_its_pixels_is_refused(workspace):
    workspace.metrics_json.write_text(json.dumps({"psnr_db": 30.0}))
    with pytest.raises(BadInput, match=r"has no ssim.*; run `cotton3dg train --force`"):
        traits.run(workspace, TraitsOptions())


def test_what_is_missing_is_named(workspace):
    workspace.scale_json.unlink()
    with pytest.raises(MissingInput, match="cotton3dg scale"):
        traits.run(workspace, TraitsOptions())


def test_a_turned_scene_gives_the_same_traits(workspace):
    """Nothing depends on how structure from motion happened to lay the axes."""
    traits.run(workspace, TraitsOptions())
    (before,) = rows(workspace.traits_csv)
    turned = type(POSE)(3.7, Rotation.from_euler("xyz", (-30, 70, 10), degrees=True).as_matrix(), POSE.shift * 2)
    gaussians, labels = plant_scene(pose=turned)
    write_gaussians(workspace.gaussians_ply, gaussians)
    write_bolls(workspace, labels)
    table_scale(turned).save(workspace.scale_json)
    train_metrics(pixel_su=1e-3, psnr_db=31.4159).save(workspace.metrics_json)
    traits.run(workspace, TraitsOptions())
    (after,) = rows(workspace.traits_csv)
    for column in TRAITS:
        compared = column.name.endswith(("_cm", "_cm3")) and column.name != "plant_height_obb_cm"
        if compared and not column.name.startswith("original_"):  # blank, as nothing was corrected
            assert float(after[column.name]) == pytest.approx(float(before[column.name]), rel=0.01)


@pytest.mark.slow
def test_twigs_that_only_the_photos_show_make_the_plant_larger(workspace, monkeypatch):
    """From the outermost boll on, 12 cm farther out, and over a gap inside of the plant; without photos nothing."""
    alone = traits.run(workspace, TraitsOptions()).summary
    cameras = orbit(4)
    asked = []
    out = BOLLS_CM[1] - FOOT_CM + np.linspace([BOLL_RADIUS_CM, 0, 0], [BOLL_RADIUS_CM + 12, 0, 0], 49)
    inside = np.linspace([0, 0, 20.0], [3, 3, 30], 40)

    def followed(plant_map, opaque, scale, foot, cameras, photo):
        asked.append(photo(cameras[0].name).shape)
        return [Trail(out, False), Trail(inside, True)]

    monkeypatch.setattr(traits, "_cameras", lambda workspace: cameras)
    monkeypatch.setattr(traits, "follow_thin_twigs", followed)
    assert traits.run(workspace, TraitsOptions()).summary == alone
    mapped = []
    real_map = traits.map_gaussians

    def kept(*given):
        mapped.append(given[6])
        return real_map(*given)

    monkeypatch.setattr(traits, "map_gaussians", kept)
    for camera in cameras:
        photo = workspace.undistorted_image(camera.name)
        photo.parent.mkdir(parents=True, exist_ok=True)
        write_image(photo, np.zeros((camera.height, camera.width, 3), np.uint8))
    outcome = traits.run(workspace, TraitsOptions())
    assert asked == [(cameras[0].height, cameras[0].width, 3)]
    assert "thin_ends" in outcome.flags and "1 followed" in " ".join(outcome.warnings)
    (row,) = rows(workspace.traits_csv)
    # The mean of two sides; the least rectangle turns with the twig.
    assert 5 < float(row["canopy_size_cm"]) - alone["canopy_size_cm"] < 9
    assert float(row["plant_height_cm"]) == pytest.approx(alone["plant_height_cm"], abs=0.01)
    assert float(row["boll_volume_cm3"]) == pytest.approx(alone["boll_volume_cm3"], rel=1e-3)
    assert [len(trails) for trails in mapped] == [0, 2]
