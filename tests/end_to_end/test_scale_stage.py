# SPDX-License-Identifier: Apache-2.0
"""The scale stage on a made room: COLMAP model, photos and Gaussians in, scale.json and pictures out."""

import json

import pytest
from scenes.table_scene import POSE, orbit, photo
from scenes.table_workspace import table_workspace

from cotton3dg.errors import MissingInput, NoScale
from cotton3dg.io.images import read_image
from cotton3dg.options import ScaleOptions
from cotton3dg.scale import stage as scale
from cotton3dg.schemas.scale import ScaleInfo, read_scale
from cotton3dg.workspace import Workspace

CAMERAS = orbit(16, 320, 180)


@pytest.fixture(scope="module")
def photos():
    return [photo(camera) for camera in CAMERAS]


@pytest.fixture
def workspace(tmp_path, photos):
    return table_workspace(tmp_path, CAMERAS, photos)


def test_the_table_gives_the_scale(workspace):
    outcome = scale.run(workspace, ScaleOptions())
    found = read_scale(workspace.scale_json)
    assert found.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.005)
    assert found.source == "table"
    assert outcome.flags == ("table_size_assumed",)
    assert outcome.summary["table"] == "taken as 120 x 60 cm"
    evidence = json.loads(workspace.scale_json.read_text())["evidence"]
    assert evidence["aspect"] == pytest.approx(2.0, rel=0.02)
    assert evidence["fill"] > 0.8
    assert len(evidence["edge_residuals_px"]) == 4
    pictures = sorted(path.name for path in workspace.scale_json.parent.glob("*.jpg"))
    assert pictures == ["table_0.jpg", "table_1.jpg", "table_2.jpg"]
    assert read_image(workspace.scale_json.parent / "table_0.jpg").shape == (180, 320, 3)


def test_another_size_of_table_gives_another_scale(workspace):
    for sides in ((240.0, 120.0), (120.0, 240.0)):  # in either order
        outcome = scale.run(workspace, ScaleOptions(table_length_cm=sides[0], table_width_cm=sides[1]))
        assert outcome.flags == ()
        assert ScaleInfo.load(workspace.scale_json).table_words == "table of 240 x 120 cm"
        assert read_scale(workspace.scale_json).cm_per_su == pytest.approx(2 * POSE.cm_per_su, rel=0.005)


def test_a_table_of_another_shape_leaves_no_scale_but_a_warning(workspace):
    outcome = scale.run(workspace, ScaleOptions(table_length_cm=100.0, table_width_cm=100.0))
    assert read_scale(workspace.scale_json) is None
    assert outcome.flags == ("no_scale",)
    assert "table" in outcome.warnings[0]
    with pytest.raises(NoScale, match="table") as error:
        scale.run(workspace, ScaleOptions(table_length_cm=100.0, table_width_cm=100.0, require_scale=True))
    assert error.value.exit_code == 5


def test_none_is_none(workspace):
    outcome = scale.run(workspace, ScaleOptions(method="none"))
    assert read_scale(workspace.scale_json) is None
    assert outcome.flags == ("no_scale",)
    assert outcome.warnings == ()
    with pytest.raises(NoScale):
        scale.run(workspace, ScaleOptions(method="none", require_scale=True))


def test_it_says_what_is_missing(tmp_path):
    with pytest.raises(MissingInput, match="cotton3dg sfm"):
        scale.run(Workspace(tmp_path), ScaleOptions())
