# SPDX-License-Identifier: Apache-2.0
"""Telling the plant from everything else."""

import numpy as np
import pytest
from scenes.measured_plant import SCALE
from scenes.table_scene import (
    BOLL_RADIUS_CM,
    BOLLS_CM,
    FOOT_CM,
    POSE,
    gaussians_at,
    joined,
    plant_points_cm,
    plant_scene,
    table_points_cm,
)

from cotton3dg.traits.plant_segmentation import find_connected, fit_stem_axis, isolate_plant, table_coordinates


def test_table_coordinates():
    places = np.array([[0, 0, 0], [12, -7, 30.0]])
    assert table_coordinates(SCALE, POSE.scene(places)) == pytest.approx(places, abs=1e-6)


def test_the_plant_is_all_of_the_plant_and_nothing_else():
    gaussians, labels = plant_scene()
    n_plant = len(plant_points_cm(np.random.default_rng(0))[0])
    plant = isolate_plant(gaussians, SCALE, 4.0, labels > 0)
    above_clamp = POSE.cm(gaussians.means)[:n_plant, 2] > 5.0
    assert plant.rows[:n_plant][above_clamp].all()
    # What is left of the scene's 60 floaters and 3,000 other points in mid-air.
    assert plant.rows[n_plant:].sum() <= 5
    assert plant.stem_found
    assert POSE.cm(plant.foot[None])[0] == pytest.approx(FOOT_CM, abs=0.2)


def test_a_leaning_stem_is_continued_down_to_the_table():
    stem = np.linspace([0, 0, 0.0], [6, -3, 30], 150) + [10, 5, 0]
    plant = isolate_plant(gaussians_at(stem, 0.2), SCALE, 4.0, np.zeros(150, bool))
    assert POSE.cm(plant.foot[None])[0] == pytest.approx([10, 5, 0], abs=0.2)


def test_without_a_stem_the_bolls_stand_for_the_plant():
    bolls, labels = plant_points_cm(np.random.default_rng(0))
    bolls, labels = bolls[labels > 0], labels[labels > 0]
    bolls = bolls[:, :] + [0, 0, 10]
    plant = isolate_plant(gaussians_at(bolls, 0.2), SCALE, 4.0, labels > 0)
    assert plant.rows.all()
    assert not plant.stem_found


@pytest.mark.parametrize("on_it", [False, True])
def test_the_stem_is_what_holds_the_bolls_not_the_fullest_post(on_it):
    """A white tube beside the plant has more Gaussians than the stem, and its end may pass for a boll."""
    gaussians, labels = plant_scene()
    angles = np.linspace(0, 40 * np.pi, 900)
    tube = np.column_stack([1.2 * np.cos(angles), 1.2 * np.sin(angles), np.linspace(0, 14, 900)]) + [20, 8, 0]
    taken_for_boll = np.where(on_it & (tube[:, 2] < 4), labels.max() + 1, 0)
    both = joined(gaussians, gaussians_at(tube, 0.2))
    plant = isolate_plant(both, SCALE, 4.0, np.concatenate([labels, taken_for_boll]))
    assert POSE.cm(plant.foot[None])[0] == pytest.approx(FOOT_CM, abs=0.2)
    assert not plant.rows[len(gaussians) :].any()
    assert plant.rows[: len(gaussians)].sum() == isolate_plant(gaussians, SCALE, 4.0, labels).rows.sum()


def test_a_boll_on_a_twig_that_was_not_reconstructed_hangs_on_the_plant():
    gaussians, labels = plant_scene()
    places = POSE.cm(gaussians.means)
    twig = (np.linalg.norm(places - BOLLS_CM[0], axis=1) < BOLL_RADIUS_CM + 4.0) & (labels != 1)
    assert twig.any()
    cut = gaussians[~twig]
    plant = isolate_plant(cut, SCALE, 4.0, labels[~twig] > 0)
    assert not plant.apart.any()
    assert plant.rows[labels[~twig] == 1].all()


def test_an_empty_table_has_no_plant():
    table = gaussians_at(table_points_cm(np.random.default_rng(0))[:5000], 0.1)
    assert isolate_plant(table, SCALE, 4.0, np.zeros(len(table), bool)) is None


def test_stem_axis_of_two_posts_is_the_taller_one():
    tall = np.linspace([0, 0, 5.0], [0, 0, 13.0], 40)
    short = np.repeat(np.linspace([9, 0, 5.0], [9, 0, 8.0], 40), 3, axis=0)
    base, top = fit_stem_axis(np.vstack([short, tall]), 5.0)
    assert base == pytest.approx([0, 0, 0], abs=1e-6)
    assert top == pytest.approx([0, 0, 13.0], abs=1e-6)


def test_parts_are_bridged_and_specks_are_not():
    stem = np.linspace([0, 0, 0.0], [0, 0, 20], 60)
    branch = np.linspace([2.5, 0, 10], [10, 0, 10], 30)
    speck = np.linspace([-2.5, 0, 10], [-3.5, 0, 10], 3)
    far = np.linspace([0, 9.0, 10], [0, 15, 10], 40)
    bodies = np.concatenate([stem, branch, speck, far])[:, None]
    seeds = np.zeros(len(bodies), bool)
    seeds[0] = True
    assert find_connected(bodies, seeds).tolist() == [True] * 90 + [False] * 43


def test_extra_gaussians_far_away_change_nothing():
    gaussians, labels = plant_scene()
    more = joined(gaussians, gaussians_at(np.array([[300.0, 0, 50], [0, 0, 400], [0, 0, -60]]), 0.3))
    before = isolate_plant(gaussians, SCALE, 4.0, labels > 0)
    after = isolate_plant(more, SCALE, 4.0, np.append(labels > 0, [False] * 3))
    assert (after.rows == np.append(before.rows, [False] * 3)).all()
