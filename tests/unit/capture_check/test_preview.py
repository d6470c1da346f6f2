# SPDX-License-Identifier: Apache-2.0
"""Where a first look seeks the scale."""

from __future__ import annotations

import numpy as np
import pytest
from scenes.walked_film import look_of

from cotton3dg.capture_check import preview
from cotton3dg.core.scene import Camera
from cotton3dg.geometry.camera_orbit import fit_orbit
from cotton3dg.options import ScaleOptions
from cotton3dg.scale.estimate_scale import FoundScale, Plant, no_scale


@pytest.mark.parametrize(
    ("outlined", "found", "tried"),
    [
        ({0}, {0}, [0]),  # structure from motion has the whole table
        ({2}, {2}, [2]),  # only places at which photos agree have it
        ({1, 3}, {3}, [1, 3]),
        (set(), {1}, [0, 1]),  # nothing tells what to try first
        ({2}, {0}, [2, 0]),
        ({3}, set(), [3, 0, 1, 2]),
    ],
)
def test_the_scale_is_sought_first_where_points_outline_the_table(
    monkeypatch: pytest.MonkeyPatch, cameras: list[Camera], outlined: set[int], found: set[int], tried: list[int]
) -> None:
    """The sources are told by how many places they have besides the tracks: none, then more with each tolerance."""
    sought: list[int] = []
    a_scale = look_of(cameras).scale

    def estimate_scale(plant: Plant, *_: object, **__: object) -> FoundScale:
        sought.append(len(plant.solid))
        return a_scale if len(plant.solid) in found else no_scale(f"no table in {len(plant.solid)}")

    monkeypatch.setattr(preview, "estimate_scale", estimate_scale)
    monkeypatch.setattr(preview, "outlines_table", lambda points, *_: len(points) in outlined)
    monkeypatch.setattr(
        preview, "find_agreeing_places", lambda *arguments: np.zeros((1 + preview.TOLERANCES.index(arguments[-1]), 3))
    )
    plant = Plant(cameras, lambda _: np.zeros((2, 2, 3), np.uint8), np.zeros((0, 3)), np.zeros((0, 3), np.float32))
    result = preview._estimate_scale(plant, fit_orbit(cameras), cameras, [], ScaleOptions())
    assert sought == tried
    assert (result.info.scale is not None) == bool(found)
    if not found:
        assert result.info.reason == f"no table in {tried[0]}"
    result = preview._estimate_scale(plant, fit_orbit(cameras), cameras, [], ScaleOptions(method="none"))
    assert result.info.scale is None
