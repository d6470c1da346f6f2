# SPDX-License-Identifier: Apache-2.0
"""Bolls whose branch may have been mixed up with one that passes near it."""

from dataclasses import replace

import numpy as np
import pytest
from scenes.branch_scene import line

from cotton3dg.core.plant_map import Axis, BollOnMap, PlantMap
from cotton3dg.plant_map.branch_confidence import STILL_RIGHT, lower_confidence

STEM = line((0, 0, 0), (0, 0, 60), spacing=0.25)
LEVEL = line((0, 0, 20), (24, 0, 20), spacing=0.25)


def crossing(away_cm: float) -> np.ndarray:
    """Leaves the stem above `LEVEL` and passes beside it, at 12 cm from the stem."""
    return line((0, 0, 32), (12, away_cm, 20), (24, 2 * away_cm, 8), spacing=0.25)


def axis(rank: int, curve: np.ndarray, parent: int = 0) -> Axis:
    return Axis(rank, "fruiting" if rank else "stem", parent if rank else -1, curve, np.full(len(curve), np.nan), 1.0)


def boll(boll_id: int, branch: int, path_cm: float) -> BollOnMap:
    return BollOnMap(boll_id, branch, 1, np.zeros((2, 3)), path_cm, 1, 0.9, 0.9)


def confidences(curves: list[np.ndarray], bolls: list[BollOnMap], parents: dict[int, int] | None = None) -> list[float]:
    axes = [axis(rank, curve, (parents or {}).get(rank, 0)) for rank, curve in enumerate(curves)]
    plant_map = PlantMap(tuple(axes), tuple(bolls))
    found = lower_confidence(plant_map)
    same = [replace(boll, confidence=0.9) for boll in found.bolls]
    assert same == bolls and found.axes == plant_map.axes
    return [boll.confidence for boll in found.bolls]


def test_beyond_a_crossing_bolls_of_both_branches_are_doubtful_and_before_it_none() -> None:
    curves = [STEM, LEVEL, crossing(0.5)]
    found = confidences(curves, [boll(1, 1, 5), boll(2, 1, 20), boll(3, 2, 5), boll(4, 2, 25), boll(5, 0, 58)])
    assert found == pytest.approx([0.9, 0.9 * STILL_RIGHT, 0.9, 0.9 * STILL_RIGHT, 0.9])


def test_branches_that_pass_at_a_distance_are_no_reason() -> None:
    assert confidences([STEM, LEVEL, crossing(2.5)], [boll(1, 1, 20)]) == [0.9]


def test_branches_that_leave_the_stem_at_one_node_are_no_reason() -> None:
    beside = line((0, 0, 20.5), (0, 24, 24), spacing=0.25)
    assert confidences([STEM, LEVEL, beside], [boll(1, 1, 20), boll(2, 2, 20)]) == [0.9, 0.9]


def test_a_branch_and_its_own_branches_are_no_reason() -> None:
    own = line((8, 0, 20), (8, 10, 26), spacing=0.25)
    assert confidences([STEM, LEVEL, own], [boll(1, 1, 20), boll(2, 2, 8)], {2: 1}) == [0.9, 0.9]


def test_what_grows_beyond_a_crossing_is_as_doubtful() -> None:
    beyond, before = (line((x, 0, 20), (x, 10, 26), spacing=0.25) for x in (20, 4))
    curves = [STEM, LEVEL, crossing(0.5), beyond, before]
    found = confidences(curves, [boll(1, 3, 8), boll(2, 4, 8)], {3: 1, 4: 1})
    assert found == pytest.approx([0.9 * STILL_RIGHT, 0.9])


def test_a_map_without_branches_stays() -> None:
    assert confidences([STEM], [boll(1, 0, 58)]) == [0.9]
    assert lower_confidence(PlantMap((), (), "no_stem")) == PlantMap((), (), "no_stem")
