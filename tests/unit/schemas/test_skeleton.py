# SPDX-License-Identifier: Apache-2.0
"""The plant map as a document."""

import pytest
from scenes.branch_scene import mapped

from cotton3dg.core.plant_map import PlantMap
from cotton3dg.schemas.skeleton import SkeletonInfo, describe_map, read_map


def test_a_map_that_was_written_is_read_again(tmp_path):
    describe_map(mapped()).save(tmp_path / "skeleton.json")
    again = read_map(SkeletonInfo.load(tmp_path / "skeleton.json"))
    for axis, other in zip(mapped().axes, again.axes, strict=True):
        assert other.curve == pytest.approx(axis.curve, abs=1e-4)
        assert (axis.rank, axis.kind, axis.parent, axis.bolls) == (other.rank, other.kind, other.parent, other.bolls)
    assert [boll.position for boll in again.bolls] == [boll.position for boll in mapped().bolls]
    describe_map(PlantMap((), (), "no_stem")).save(tmp_path / "none.json")
    assert read_map(SkeletonInfo.load(tmp_path / "none.json")).reason == "no_stem"
