# SPDX-License-Identifier: Apache-2.0
"""When a training does what: images, resolutions, density, rates, windows."""

import dataclasses
import itertools

import numpy as np
import pytest
from scenes.training_scene import OPTIONS, orbit_camera, training_scene

from cotton3dg.gaussians.metrics import PLANT_REGION
from cotton3dg.gaussians.views import View
from cotton3dg.geometry.camera_orbit import Orbit
from cotton3dg.train.schedule import (
    DENSIFY_AFTER,
    DENSIFY_EVERY,
    DENSIFY_UNTIL,
    FEWEST_DENSIFICATIONS,
    SHORTEST_STEPS,
    SURROUNDINGS_GROWTH,
    SURROUNDINGS_LOG_SCALES,
    SURROUNDINGS_MEANS,
    Schedule,
    densification_steps,
    image_order,
    learning_rates,
    rate_factors,
    resolutions,
)


def test_every_image_is_used_once_an_epoch() -> None:
    order = image_order(7, 30, 3)
    assert len(order) == 30
    assert sorted(order[:7]) == sorted(order[7:14]) == list(range(7))
    assert order[:7] != order[7:14]
    assert order == image_order(7, 30, 3) != image_order(7, 30, 4)


def test_resolution_grows_to_full_size() -> None:
    view = View(orbit_camera(0.0, 960, 540), np.zeros((540, 960, 3), np.uint8))
    levels = resolutions([view], 1000)
    assert [views[0].camera.width for _, views in levels] == [240, 480, 960]
    assert [until for until, _ in levels] == sorted({until for until, _ in levels})
    assert levels[-1][0] == 1000
    assert [len(resolutions([view.limited(side)], 10)) for side in (64, 480)] == [1, 2]


@pytest.mark.parametrize(("steps", "n_views"), [(2000, 44), (3000, 87), (3000, 26), (30000, 130)])
def test_density_is_controlled_after_whole_epochs(steps: int, n_views: int) -> None:
    """What few views show must not be called hidden because a window missed them."""
    densifications = densification_steps(steps, n_views)
    order = image_order(n_views, steps, 0)
    for begin, end in itertools.pairwise([0, *densifications]):
        counts = np.bincount(order[begin:end], minlength=n_views)
        assert counts.min() == counts.max() >= 1
    assert all(DENSIFY_AFTER * steps < step <= DENSIFY_UNTIL * steps for step in densifications)
    every = densifications.step / steps
    assert densifications.step == n_views or every == pytest.approx(DENSIFY_EVERY, abs=n_views / steps / 2)


def test_the_presets_change_the_density_when_they_always_did() -> None:
    assert densification_steps(2500, 88) == range(264, 1001, 88)  # standard: 100 images, 12 of them held out
    assert densification_steps(1500, 52) == range(156, 601, 52)  # draft: 60 images, 8 of them held out
    assert densification_steps(30_000, 88) == range(2024, 12_001, 440)


@pytest.mark.parametrize(("steps", "n_views"), [(100, 52), (250, 52), (300, 88), (500, 88), (10, 1000)])
def test_short_trainings_change_the_density_too(steps: int, n_views: int) -> None:
    densifications = densification_steps(steps, n_views)
    assert FEWEST_DENSIFICATIONS <= len(densifications) <= FEWEST_DENSIFICATIONS + 1
    assert 0 < densifications[0] <= 0.11 * steps
    assert 0.35 * steps <= densifications[-1] <= DENSIFY_UNTIL * steps


def test_rates_decay_grow_with_the_scene_and_are_the_papers_at_its_length() -> None:
    start, end = learning_rates(0, 30_000, 2.0), learning_rates(30_000, 30_000, 2.0)
    assert (start.means, start.log_scales, start.quats, start.sh0) == pytest.approx((3.2e-4, 5e-3, 1e-3, 2.5e-3))
    assert end.means == pytest.approx(start.means / 100)
    assert end.log_scales < start.log_scales
    assert learning_rates(5, 10, 2.0).means == pytest.approx(2 * learning_rates(5, 10, 1.0).means)
    assert learning_rates(0, 1000, 1.0).means > learning_rates(0, 3000, 1.0).means


def test_the_rates_of_the_shortest_trainings_are_bounded() -> None:
    assert learning_rates(0, 1, 1.0) == learning_rates(0, 100, 1.0) == learning_rates(0, SHORTEST_STEPS, 1.0)
    assert learning_rates(0, 1, 1.0).log_scales < 0.15


def test_rates_grow_around_the_plant_up_to_a_limit() -> None:
    orbit = Orbit(np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.0, 1.0]), 4.0, 4.0, 360.0, 0.0)
    radii = np.array([0.0, 1.0, 1.5, 1e6, np.inf, np.nan])
    means = np.stack([1 + PLANT_REGION * 4 * radii, np.full(6, 2.0), np.full(6, 3.0)], axis=1)
    factors = rate_factors(means.astype(np.float32), orbit)
    far, limits = 1 + 0.5 * SURROUNDINGS_GROWTH, [SURROUNDINGS_MEANS, SURROUNDINGS_LOG_SCALES]
    assert factors.dtype == np.float32
    assert factors.tolist() == [[1, 1], [1, 1], [far, far], limits, limits, [1, 1]]
    assert rate_factors(means[:2].astype(np.float32), dataclasses.replace(orbit, distance=0.0)).tolist() == [
        [1, 1],
        limits,
    ]


def test_windows_take_three_of_four_epochs_once_the_count_is_settled() -> None:
    _, views, _ = training_scene()
    options = dataclasses.replace(OPTIONS, steps=40 * len(views))
    schedule = Schedule.of(views, options, [(0, 0, 16, 16)] * len(views))
    settled = max(schedule.densifications[-1], *(until for until, _ in schedule.levels[:-1]), 0)
    looks = [(schedule.order[step], schedule.window(step)) for step in range(options.steps)]
    assert not any(window for _, window in looks[:settled])
    for view in range(len(views)):
        whole = "".join("." if window else "W" for index, window in looks[settled:] if index == view)
        assert "...." not in whole
        assert whole.count("W") < 0.35 * len(whole)
