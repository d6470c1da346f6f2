# SPDX-License-Identifier: Apache-2.0
"""How long a scene unit is to the stage cluster, and when that makes its result out of date."""

from dataclasses import replace

import numpy as np
import pytest

from cotton3dg.cluster.stage import parts, read_unit_length
from cotton3dg.core.measurements import Scale
from cotton3dg.errors import BadInput
from cotton3dg.options import resolve
from cotton3dg.schemas.scale import ScaleInfo
from cotton3dg.workspace import Workspace

BOLLS = resolve("cluster")


@pytest.fixture
def workspace(tmp_path):
    (tmp_path / "scale").mkdir()
    return Workspace(tmp_path)


def info(cm_per_su):
    up = np.array([0.0, 0.0, 1.0])
    return ScaleInfo.of_scale(Scale(cm_per_su, 0.002, "table", up, np.array([*up, 0.0]), np.zeros((4, 3))))


def parts_after(workspace, said):
    said.save(workspace.scale_json)
    return parts(workspace, BOLLS)


@pytest.mark.parametrize("cm_per_su", [0.013, 1.0, 37.0, 4100.0])
def test_it_is_known_to_a_few_per_cent(workspace, cm_per_su):
    info(cm_per_su).save(workspace.scale_json)
    assert read_unit_length(workspace) == pytest.approx(cm_per_su, rel=0.025)


def test_bolls_are_sought_again_when_bolls_have_another_size(workspace):
    before = parts_after(workspace, info(36.0))
    assert parts_after(workspace, info(36.0 + 1e-6)) == before
    assert parts_after(workspace, info(40.0)) != before
    assert parts_after(workspace, ScaleInfo("none", "no table")) != before


def test_corners_that_a_person_moved_leave_the_bolls_as_they_are(workspace):
    before = parts_after(workspace, info(36.0))
    assert parts_after(workspace, replace(info(50.0), found=info(36.0))) == before


def test_without_a_scale_bolls_are_found_all_the_same(workspace):
    assert read_unit_length(workspace) is None
    before = parts(workspace, BOLLS)
    assert parts_after(workspace, ScaleInfo("none", "no table")) == before
    assert read_unit_length(workspace) is None


def test_a_damaged_scale_is_said_when_the_stage_runs(workspace):
    before = parts(workspace, BOLLS)
    workspace.scale_json.write_text("{")
    assert parts(workspace, BOLLS) != before
    with pytest.raises(BadInput, match=r"scale\.json"):
        read_unit_length(workspace)
