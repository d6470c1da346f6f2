# SPDX-License-Identifier: Apache-2.0
"""Scores of the plant map against the truth."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cotton3dg.cli.display import print_map_scores
from cotton3dg.core.plant_map import Axis, PlantMap
from cotton3dg.evaluation.plant_map import compare_maps, match_branches, true_map
from cotton3dg.geometry.polylines import length_of
from cotton3dg.options import SimulateOptions
from cotton3dg.schemas.truth import Truth
from cotton3dg.simulate.plant import grow_plant
from cotton3dg.simulate.truth import plant_truth


@cache
def natural() -> tuple[PlantMap, np.ndarray]:
    """The true map of a simulated plant, and its bolls' centres, cm."""
    options = SimulateOptions(seed=8, architecture="natural", bolls=10, vegetative=1)
    truth = Truth.parsed(plant_truth(grow_plant(options), options))
    centres = np.array([boll.centre_xyz_m for boll in truth.bolls]) - truth.stem_base_xyz_m
    return true_map(truth), 100 * centres


def test_the_truth_scores_full_marks_against_itself():
    true, centres = natural()
    scores = compare_maps(true, centres, list(range(1, len(centres) + 1)), true, centres)
    assert scores.f1 == 1
    assert scores.angle_error_deg == pytest.approx(0)
    assert scores.bolls_on_branch == scores.bolls == len(centres)
    assert scores.positions_right == scores.positions
    assert scores.stem_diameter_error_mm == pytest.approx(0)
    assert {"stem", "fruiting", "vegetative"} == {axis.kind for axis in true.axes}


def test_no_word_of_fruiting_positions_where_the_truth_has_none(capsys):
    true, centres = natural()
    scores = compare_maps(true, centres, list(range(1, len(centres) + 1)), true, centres)
    print_map_scores(scores)
    assert f"fruiting position right: {scores.positions} of {scores.positions}" in capsys.readouterr().out
    print_map_scores(replace(scores, positions=0, positions_right=0))
    assert "position" not in capsys.readouterr().out


def test_half_a_turn_of_the_table_is_no_error():
    true, centres = natural()
    turn = np.array([-1, -1, 1])
    turned = replace(true, axes=tuple(replace(axis, curve=axis.curve * turn) for axis in true.axes))
    assert compare_maps(turned, centres * turn, list(range(1, len(centres) + 1)), true, centres).f1 == 1


def test_missed_false_and_mistaken_branches_cost():
    true, centres = natural()
    fruiting = [axis for axis in true.branches if axis.kind == "fruiting" and length_of(axis.curve) > 6]
    lost = fruiting[0]
    kept = tuple(replace(axis, curve=axis.curve + (9, 9, 0)) if axis.rank == lost.rank else axis for axis in true.axes)
    scores = compare_maps(replace(true, axes=kept), centres, list(range(1, len(centres) + 1)), true, centres)
    assert scores.matched_branches == scores.true_branches - 1
    assert scores.precision == scores.recall < 1
    assert scores.bolls_on_branch == len(centres) - len(lost.bolls)
    assert scores.doubtful == scores.doubtful_on_branch == 0
    doubts = tuple(replace(boll, confidence=0.69 if boll.boll_id in lost.bolls[:1] else 1.0) for boll in true.bolls)
    doubted = compare_maps(
        replace(true, axes=kept, bolls=doubts), centres, list(range(1, len(centres) + 1)), true, centres
    )
    assert (doubted.doubtful, doubted.doubtful_on_branch) == (1, 0)
    nothing = compare_maps(PlantMap(true.axes[:1], ()), centres, list(range(1, 11)), true, centres)
    assert nothing.recall == 0
    assert nothing.bolls_on_branch == 0


def test_branches_are_matched_by_foot_and_direction():
    def branch(foot, tip):
        curve = np.linspace(foot, tip, 20)
        return Axis(1, "fruiting", 0, curve, np.full(20, 0.2), 1.0)

    true = (branch((0, 0, 10), (10, 0, 15)), branch((0, 0, 14), (-10, 0, 19)))
    found = (branch((0, 0, 14.5), (-10, 1, 20)), branch((0, 0, 10), (0, 10, 15)))
    assert match_branches(found, true) == [(0, 1)]
