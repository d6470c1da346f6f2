# SPDX-License-Identifier: Apache-2.0
"""A scanner's point cloud as truth: the same traits by the same code."""

import numpy as np
import open3d as o3d
import pytest
from scenes.branch_scene import branch_scene
from scenes.table_scene import BOLL_RADIUS_CM, BOLLS_CM, FOOT_CM, plant_points_cm

from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.evaluation.cloud import find_table_height, measure_cloud
from cotton3dg.evaluation.plant import evaluate_cloud
from cotton3dg.io.cloud import read_cloud
from cotton3dg.plant_map.summary import summarise_map
from cotton3dg.workspace import Workspace

BOLL_CM3 = 4 / 3 * np.pi * BOLL_RADIUS_CM**3


def scan(lift_cm=30.0):
    """A plant with bolls of the full radius on a table with a clamp, and its labels."""
    rng = np.random.default_rng(0)
    plant, labels = plant_points_cm(rng)
    for boll, centre in enumerate(BOLLS_CM, 1):
        own = plant[labels == boll] - centre
        plant[labels == boll] = centre + own * BOLL_RADIUS_CM / np.linalg.norm(own, axis=1, keepdims=True)
    table = rng.uniform([-60, -30, 0], [60, 30, 0], (4000, 3))
    clamp = rng.uniform([-12, -7, 0], [20, 1, 4], (800, 3))
    points = np.concatenate([plant, table, clamp])
    return points + (0, 0, lift_cm), np.concatenate([labels, np.zeros(4800, int)])


def test_a_scan_with_a_table_gives_the_plant_alone():
    points, labels = scan()
    found = measure_cloud(points, labels)
    assert found.on_table
    assert found.silhouette.height_cm == pytest.approx(70.0, abs=0.2)
    alone = measure_cloud(points[labels > 0] - (*FOOT_CM[:2], 30.0))
    assert found.silhouette.length_cm == pytest.approx(alone.silhouette.length_cm, rel=0.05)
    assert found.boll_volumes_cm3 == pytest.approx(np.full(4, BOLL_CM3), rel=0.05)


def test_a_cropped_scan_counts_heights_from_its_lowest_point():
    points, _ = scan()
    cropped = points[points[:, 2] > 34.4]
    found = measure_cloud(cropped[np.linalg.norm(cropped[:, :2], axis=1) < 28])
    assert not found.on_table
    assert found.silhouette.height_cm == pytest.approx(70.0 - 4.5, abs=0.2)
    assert len(found.boll_volumes_cm3) == 0


def test_without_a_table_the_stem_stands_where_it_is():
    """Its foot was taken to be the scanner's origin: a plant one metre from it had a stem one metre too long."""
    scene = branch_scene()
    stems = [measure_cloud(scene.places + away).plant_map for away in ((0.0, 0.0, 0.0), (100.0, -50.0, 20.0))]
    here, there = (summarise_map(plant_map, 0.0, 0.0, 0.0) for plant_map in stems)
    assert here.stem_length_cm == pytest.approx(55, abs=1.5)
    assert there.stem_length_cm == pytest.approx(here.stem_length_cm, abs=0.3)
    assert there.stem_lean_deg < 2


def test_the_cloud_of_a_room_has_no_plant_map():
    """Its graph has no end, or hangs together nowhere: this took minutes, or failed."""
    room = np.random.default_rng(1).uniform(-900, 900, (6000, 3))
    found = measure_cloud(room)
    assert found.plant_map.axes == ()
    assert found.plant_map.reason == "no_plant"


def test_the_table_is_the_fullest_layer():
    points, _ = scan()
    assert find_table_height(points[:, 2]) == pytest.approx(30.0, abs=0.1)
    assert find_table_height(np.linspace(0, 100, 1000)) is None


def test_clouds_are_read_in_all_formats(tmp_path):
    points, labels = np.random.default_rng(0).uniform(0, 1, (50, 3)), np.arange(50) % 3
    np.savetxt(tmp_path / "a.xyz", np.column_stack([points, labels]))
    np.savetxt(tmp_path / "b.csv", points, delimiter=",", header="x,y,z", comments="")
    cloud = o3d.t.geometry.PointCloud(points)
    cloud.point["boll_id"] = labels.reshape(-1, 1).astype(np.int32)
    o3d.t.io.write_point_cloud(str(tmp_path / "c.ply"), cloud)
    o3d.t.io.write_point_cloud(str(tmp_path / "d.pcd"), o3d.t.geometry.PointCloud(points))
    for name, has_labels in (("a.xyz", True), ("b.csv", False), ("c.ply", True), ("d.pcd", False)):
        read, numbers = read_cloud(tmp_path / name, 10.0)
        assert read == pytest.approx(10 * points, rel=1e-6)
        assert (numbers is not None) == has_labels
        assert not has_labels or (numbers == labels).all()


POINTS = np.array([[0.1, -0.2, 0.3], [0.2, -0.2, 0.3], [0.1, -0.3, 0.3], [0.1, -0.2, 1.4]])


@pytest.mark.parametrize(
    ("text", "labels"),
    [
        ("0.1 -0.2 0.3|0.2 -0.2 0.3|0.1 -0.3 0.3|0.1 -0.2 1.4", None),
        ("4|0.1 -0.2 0.3|0.2 -0.2 0.3|0.1 -0.3 0.3|0.1 -0.2 1.4", None),
        ("X;Y;Z|0,1;-0,2;0,3|0,2;-0,2;0,3|0,1;-0,3;0,3|0,1;-0,2;1,4", None),
        ("0,1 -0,2 0,3|0,2 -0,2 0,3|0,1 -0,3 0,3|0,1 -0,2 1,4", None),
        ("0.1, -0.2, 0.3|0.2, -0.2, 0.3|0.1, -0.3, 0.3|0.1, -0.2, 1.4", None),
        ("//X Y Z Intensity|0.1 -0.2 0.3 98|0.2 -0.2 0.3 127|0.1 -0.3 0.3 98|0.1 -0.2 1.4 76", None),
        ("#x y z label|0.1 -0.2 0.3 1|0.2 -0.2 0.3 0|0.1 -0.3 0.3 1|0.1 -0.2 1.4 2", [1, 0, 1, 2]),
        ("boll_id,x,y,z|1,0.1,-0.2,0.3|0,0.2,-0.2,0.3|1,0.1,-0.3,0.3|2,0.1,-0.2,1.4", [1, 0, 1, 2]),
        ("0.1 -0.2 0.3 1|0.2 -0.2 0.3 0|0.1 -0.3 0.3 1|0.1 -0.2 1.4 2", [1, 0, 1, 2]),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_text_of_any_program_is_read(tmp_path, text, labels, encoding):
    (tmp_path / "a.xyz").write_text(text.replace("|", "\r\n"), encoding=encoding, newline="")
    read, numbers = read_cloud(tmp_path / "a.xyz", 100.0)
    assert read == pytest.approx(100 * POINTS)
    assert (None if numbers is None else numbers.tolist()) == labels


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ([0.86, 0.94, 0.65, 0.37], "has fractions, so it is not a boll id; leave that column out"),
        ([198, 76, 76, 198], "lie 62 cm apart, so it is not a boll id"),
        ([-1, 0, 1, 2], "is not a boll id"),
    ],
)
def test_intensities_are_not_boll_ids(tmp_path, column, words):
    """210 "true bolls" of 1.4 million cm3."""
    np.savetxt(tmp_path / "a.xyz", np.column_stack([POINTS, column]))
    cloud = o3d.t.geometry.PointCloud(POINTS)
    cloud.point["label"] = np.array(column, np.float32).reshape(-1, 1)
    o3d.t.io.write_point_cloud(str(tmp_path / "a.ply"), cloud)
    for name in ("a.xyz", "a.ply"):
        with pytest.raises(BadInput, match=words):
            read_cloud(tmp_path / name, 100.0)


def test_clouds_that_cannot_be_used_are_refused(tmp_path):
    with pytest.raises(MissingInput, match=r"none\.ply"):
        read_cloud(tmp_path / "none.ply", 1.0)
    for name, content, word in (
        ("a.las", b"LASF", "export"),
        ("b.xyz", b"1 2 3\n4 five 6\n", "line 2 is not 3 numbers: '4 five 6'"),
        ("f.xyz", b"1 2 3\n4 5 6\n7 8\n", "line 3 is not 3 numbers"),
        ("g.xyz", b"1 2 3\n4 5 6\nnan nan nan\n", "line 3 is not 3 numbers"),
        ("h.csv", b"id,x,y,height\n1,2,3,4\n", "where x, y or z is missing"),
        ("i.xyz", b"1 2 3\n4 5 6 # \xc3\xde\xc1\xe5\n", "line 2, is not in UTF-8"),
        ("c.xyz", b"1 2 3\n4 5 6\n", "2 points"),
        ("d.ply", b"ply\nnothing", "d.ply"),
        ("e.xyz", b"", "cannot be read"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(BadInput, match=word):
            read_cloud(tmp_path / name, 1.0)


def test_a_plant_beside_its_scan(tmp_path):
    workspace = Workspace(tmp_path)
    workspace.traits_csv.parent.mkdir()
    workspace.traits_csv.write_text(
        "boll_count,boll_volume_cm3,plant_height_cm,plant_height_obb_cm,canopy_size_cm,canopy_length_cm,"
        "canopy_width_cm,plant_hull_volume_cm3\n4,300,77,70,,30,30,1000\n"
    )
    points, labels = scan()
    np.savetxt(tmp_path / "scan.xyz", np.column_stack([points / 100, labels]))
    errors = {item.trait: item for item in evaluate_cloud(workspace, tmp_path / "scan.xyz", 100.0)}
    assert errors["plant_height_cm"].error_pct == pytest.approx(10.0, abs=0.5)
    assert errors["boll_count"].error_pct == 0.0
    assert errors["boll_volume_cm3"].truth == pytest.approx(4 * BOLL_CM3, rel=0.05)
    assert np.isnan(errors["canopy_size_cm"].error_pct)
    heap = points[labels == 1] / 100
    np.savetxt(tmp_path / "heap.csv", heap, "%.5f", delimiter=";", header="X;Y;Z", comments="")
    text = (tmp_path / "heap.csv").read_text().replace(".", ",")
    (tmp_path / "heap.csv").write_text(text)
    with pytest.raises(BadInput, match=r"heap\.csv shows no plant; it needs all of one with z up"):
        evaluate_cloud(workspace, tmp_path / "heap.csv", 100.0)
