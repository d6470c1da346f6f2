# SPDX-License-Identifier: Apache-2.0
"""The scale stage with markers, picked points, sections and several references, on photos of markers on a table."""

import csv
import json

import numpy as np
import pytest
from scenes.marker_scene import photo_of_top, top_picture
from scenes.table_scene import POSE, orbit
from scenes.table_workspace import table_workspace

from cotton3dg.errors import BadUsage, MissingInput
from cotton3dg.options import ScaleOptions, resolve
from cotton3dg.scale import stage as scale
from cotton3dg.schemas.scale import read_scale

CAMERAS = orbit(12, 960, 540)
MARKERS = {0: (-44, 8, 0.1), 1: (44, -10, -0.2), 2: (-44, -14, 0.05), 3: (44, 14, 0.0)}


@pytest.fixture(scope="module")
def photos():
    top = top_picture(MARKERS, side_cm=14.0)
    return [photo_of_top(camera, top) for camera in CAMERAS]


@pytest.fixture
def workspace(tmp_path, photos):
    return table_workspace(tmp_path, CAMERAS, photos)


def facts(workspace):
    return json.loads(workspace.scale_json.read_text())


def pick(workspace, points_cm, views=(1, 4, 8)):
    with workspace.scale_points.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["point", "image", "x_px", "y_px"])
        for name, point in zip("ab", np.asarray(points_cm, float), strict=True):
            for view in views:
                (place,), _ = CAMERAS[view].project(POSE.scene(point[None]))
                rows.writerow([name, CAMERAS[view].name, *np.round(place - 0.5)])


def test_markers_give_the_scale_and_a_picture(workspace):
    outcome = scale.run(workspace, resolve("scale", {"method": "aruco", "marker_cm": 14.0}))
    found = read_scale(workspace.scale_json)
    assert found.source == "aruco"
    assert found.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.005)
    assert outcome.flags == ()
    assert facts(workspace)["evidence"]["markers"] == [0, 1, 2, 3]
    assert found.height_cm(POSE.scene(np.array([[0, 0, 20.0]]))) == pytest.approx([20.0], abs=0.4)
    assert sorted(path.name for path in workspace.scale_json.parent.glob("*.jpg")) == [
        f"markers_{n}.jpg" for n in range(3)
    ]


def test_all_references_are_reconciled(workspace):
    pick(workspace, [[-60, -30, 0], [60, 30, 0]])
    options = resolve("scale", {"method": "all", "marker_cm": 14.0, "distance_cm": float(np.hypot(120, 60))})
    outcome = scale.run(workspace, options)
    found = read_scale(workspace.scale_json)
    assert set(found.source.split("+")) == {"table", "aruco", "distance"}
    assert found.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.004)
    assert outcome.flags == ()
    assert len(facts(workspace)["references"]) == 3


def test_a_wrong_table_size_is_flagged_beside_markers(workspace):
    outcome = scale.run(
        workspace,
        resolve("scale", {"method": "all", "marker_cm": 14.0, "table_length_cm": 140.0, "table_width_cm": 70.0}),
    )
    assert "references_disagree" in outcome.flags
    assert "%" in outcome.warnings[-1]
    # Two references alone cannot tell which of them is wrong; one is taken as it is, never a mixture.
    found = read_scale(workspace.scale_json)
    right = found.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.005)
    assert right or found.cm_per_su == pytest.approx(POSE.cm_per_su * 140 / 120, rel=0.005)


def test_picked_points_give_the_scale(workspace):
    pick(workspace, [[-60, -30, 0], [60, 30, 0]])
    scale.run(workspace, resolve("scale", {"method": "distance", "distance_cm": float(np.hypot(120, 60))}))
    found = read_scale(workspace.scale_json)
    assert found.source == "distance"
    assert found.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.006)
    assert (workspace.scale_json.parent / "points_0.jpg").is_file()


def test_distance_without_points_or_length_says_what_to_do(workspace):
    with pytest.raises(BadUsage, match="--distance-cm"):
        scale.run(workspace, ScaleOptions(method="distance"))
    with pytest.raises(MissingInput, match=r"scale_points\.csv"):
        scale.run(workspace, resolve("scale", {"method": "distance", "distance_cm": 100.0}))


@pytest.mark.parametrize("method", ["sections", "all-sections"])
def test_sections_give_the_scale_of_the_points(workspace, method):
    scale.run(workspace, ScaleOptions(method=method))
    found = read_scale(workspace.scale_json)
    assert found.source == method
    assert found.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.02)
    assert (workspace.scale_json.parent / "sections.jpg").is_file() == (method == "sections")


def test_no_marker_is_said(workspace):
    outcome = scale.run(workspace, resolve("scale", {"method": "aruco", "dictionary": "apriltag_36h11"}))
    assert read_scale(workspace.scale_json) is None
    assert outcome.flags == ("no_scale",)
    assert "no photo shows a marker" in outcome.warnings[0]
