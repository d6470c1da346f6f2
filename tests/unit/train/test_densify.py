# SPDX-License-Identifier: Apache-2.0
"""Density control: budget, splitting, pruning, spoilt statistics."""

import numpy as np
import pytest

from cotton3dg.core.scene import Gaussians, rotations
from cotton3dg.train.densify import (
    SPLIT_SHRINKAGE,
    densify,
    find_contributing,
    find_worth_keeping,
    growth_score,
    order_along_curve,
    scheduled_count,
    split,
)


def some_gaussians(n: int, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    shapes = ((n, 3), (n, 4), (n, 3), (n,), (n, 4, 3))
    return Gaussians(*(rng.normal(size=shape).astype(np.float32) for shape in shapes))


def covariances(gaussians: Gaussians) -> np.ndarray:
    factors = rotations(gaussians.quats) * gaussians.scales[:, None, :]
    return factors @ factors.transpose(0, 2, 1)


def test_split_keeps_mean_second_moment_and_shrinks_the_longest_axis_only() -> None:
    parents = some_gaussians(20)
    first, second = split(parents)
    np.testing.assert_allclose((first.means + second.means) / 2, parents.means, atol=1e-5)
    offsets = (first.means - second.means) / 2
    moment = covariances(first) + offsets[:, :, None] * offsets[:, None, :]
    np.testing.assert_allclose(moment, covariances(parents), rtol=1e-3, atol=1e-4)
    ratio = np.sort(parents.scales / first.scales, axis=1)
    np.testing.assert_allclose(ratio, np.tile([1, 1, SPLIT_SHRINKAGE], (20, 1)), rtol=1e-5)


def test_the_neediest_are_split_until_the_count_is_met() -> None:
    gaussians = some_gaussians(10)
    need = np.arange(10.0)
    densified = densify(gaussians, np.ones(10, bool), need, 13)
    assert len(densified.gaussians) == 13
    assert (densified.n_split, densified.n_pruned) == (3, 0)
    assert sorted(densified.rows[~densified.continued]) == [7, 7, 8, 8, 9, 9]
    kept = densified.rows[densified.continued]
    np.testing.assert_array_equal(densified.gaussians.means[densified.continued], gaussians.means[kept])
    np.testing.assert_array_equal(densified.gaussians.sh, gaussians.sh[densified.rows])
    children = densified.gaussians[densified.rows == 9]
    first, second = split(gaussians[9:])
    np.testing.assert_array_equal(np.sort(children.means, axis=0), np.sort([first.means[0], second.means[0]], axis=0))
    np.testing.assert_array_equal(children.log_scales, np.tile(first.log_scales, (2, 1)))
    assert np.array_equal(order_along_curve(densified.gaussians.means), np.arange(13))


@pytest.mark.parametrize("count", [0, 1, 5, 10, 11, 20, 100])
def test_the_budget_is_never_exceeded(count: int) -> None:
    gaussians = some_gaussians(10)
    densified = densify(gaussians, np.arange(10) != 3, np.full(10, 1e30), count)
    assert len(densified.gaussians) <= count
    assert len(densified.gaussians) == min(count, 18)
    assert 3 not in densified.rows


def test_poisoned_needs_and_gaussians_are_never_chosen() -> None:
    gaussians = some_gaussians(6)
    gaussians.means[5, 0] = np.nan
    need = np.array([np.nan, np.inf, -np.inf, -1.0, 0.0, 1.0])
    densified = densify(gaussians, np.ones(6, bool), need, 100)
    assert len(densified.gaussians) == 5
    assert densified.n_pruned == 1
    assert densified.gaussians.finite_rows.all()


def test_need_is_finite_and_not_negative() -> None:
    sums = np.array([1.0, 2.0, np.nan, np.inf, -1.0, 5.0, 1e38], np.float32)
    counts = np.array([2.0, 0.0, 1.0, 1.0, 1.0, np.nan, 1e-30], np.float32)
    need = growth_score(sums, counts)
    assert np.isfinite(need).all()
    assert (need >= 0).all()
    assert need[0] == 0.5
    assert not need[1:6].any()


def test_schedule_runs_from_start_to_budget_in_python_integers() -> None:
    counts = [scheduled_count(1000, 5_000_000_000, share) for share in np.linspace(0, 1, 11)]
    assert counts[0] == 1000
    assert counts[-1] == 5_000_000_000
    assert counts == sorted(counts)
    assert all(type(count) is int for count in counts)
    assert scheduled_count(1000, 100, 0.0) == 100


def test_faint_gaussians_and_those_in_front_of_a_camera_go() -> None:
    gaussians = some_gaussians(4)
    gaussians.opacity_logits[:] = [0.0, -10.0, 0.0, np.nan]
    gaussians.means[:] = [[0, 0, 5], [0, 0, 5], [0, 0, 0.1], [0, 0, 5]]
    assert find_worth_keeping(gaussians, np.zeros((1, 3)), 0.5).tolist() == [True, False, False, False]


def test_hidden_gaussians_go_and_nothing_goes_unseen() -> None:
    weight = np.array([10.0, 12.0, 8.0, 0.1, 0.0, np.nan], np.float32)
    assert find_contributing(weight, np.array([1, 1, 1, 1, 0, 1])).tolist() == [True, True, True, False, False, False]
    assert find_contributing(np.zeros(3), np.zeros(3)).all()


def test_neighbours_in_space_become_neighbours_in_memory() -> None:
    rng = np.random.default_rng(0)
    means = rng.normal(size=(4000, 3)).astype(np.float32)
    means[7] = 1e6  # a floater makes the grid of the others no coarser
    order = order_along_curve(means)
    assert np.array_equal(np.sort(order), np.arange(len(means)))
    steps = [np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)) for points in (means, means[order])]
    assert steps[1] < 0.2 * steps[0]


def test_the_curve_visits_the_eight_cells_of_a_cube_in_morton_order() -> None:
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float32)
    shuffled = np.array([5, 2, 7, 0, 6, 1, 4, 3])
    assert np.array_equal(shuffled[order_along_curve(corners[shuffled])], np.arange(8))
    assert np.array_equal(order_along_curve(np.ones((5, 3), np.float32)), np.arange(5))
