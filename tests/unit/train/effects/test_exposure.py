# SPDX-License-Identifier: Apache-2.0
"""Gains of images, found from what the same points look like in each."""

import numpy as np
import pytest

from cotton3dg.core.scene import Camera
from cotton3dg.gaussians.views import View
from cotton3dg.options import TrainOptions
from cotton3dg.train.effects.exposure import Exposure, correct, estimate_exposure, log_gains
from cotton3dg.train.photos import SparseModel, capture_of

N_VIEWS, CELL_PX, COLUMNS, ROWS = 12, 6, 30, 20


def capture(gains: np.ndarray, noise: float = 1.0, seed: int = 0) -> tuple[list[View], list, list]:
    """Views of 600 points, each a coloured square at another place in each view, some hidden by another's square."""
    rng = np.random.default_rng(seed)
    n = COLUMNS * ROWS
    colours = rng.uniform(40, 170, (n, 3))
    views, places, points = [], [], []
    for i, gain in enumerate(gains):
        order = rng.permutation(n)
        grid = (colours[order] * gain).reshape(ROWS, COLUMNS, 3).repeat(CELL_PX, 0).repeat(CELL_PX, 1)
        image = np.clip(np.rint(grid + rng.normal(0, noise, grid.shape)), 0, 255).astype(np.uint8)
        camera = Camera(f"{i}.jpg", image.shape[1], image.shape[0], 100, 100, 90, 60, np.eye(3, 4))
        y, x = np.divmod(np.arange(n), COLUMNS)
        claimed = order.copy()
        wrong = rng.random(n) < 0.05
        claimed[wrong] = rng.permutation(claimed[wrong])
        seen = rng.random(n) < 0.5
        views.append(View(camera, image))
        places.append(np.column_stack([x, y])[seen] * CELL_PX + CELL_PX / 2)
        points.append(claimed[seen] + 7_000_000_000)  # ids of points are arbitrary
    return views, places, points


def drift(size: float) -> np.ndarray:
    """(V, 3) gains with the geometric mean one, another for each channel."""
    phase = 2 * np.pi * np.arange(N_VIEWS)[:, None] / N_VIEWS
    return np.exp(size * np.sin(phase + np.array([0.0, 0.3, 1.0])))


def test_gains_are_found_in_spite_of_noise_and_wrong_matches():
    gains = drift(0.25)
    found = estimate_exposure(*capture(gains))
    assert np.abs(np.log(found.gains / gains)).max() < 0.006
    assert found.varies
    assert found.spread == pytest.approx(np.sqrt(np.mean(np.log(gains) ** 2)), rel=0.02)
    assert found.error < 0.003


def test_a_steady_camera_gives_no_evidence():
    found = estimate_exposure(*capture(np.ones((N_VIEWS, 3)), noise=4.0))
    assert not found.varies
    assert found.spread < 0.005


@pytest.mark.parametrize(("size", "varies"), [(0.004, False), (0.03, True)])
def test_only_what_can_be_seen_is_corrected(size, varies):
    assert estimate_exposure(*capture(drift(size))).varies is varies


def test_saturated_points_do_not_pull_the_gains():
    gains = np.ones((N_VIEWS, 3))
    gains[::2] = 1.9  # a third of the points saturates in every other view
    found = estimate_exposure(*capture(gains))
    assert np.allclose(found.gains[0] / found.gains[1], 1.9, rtol=0.01)


def test_the_error_tells_how_sure_the_gains_are():
    gains = drift(0.02)
    misses = []
    for seed in range(8):
        found = estimate_exposure(*capture(gains, noise=6.0, seed=seed))
        misses.append(np.sqrt(np.mean(np.log(found.gains / gains) ** 2)) / found.error)
    assert 0.6 < np.mean(misses) < 1.6


def test_gleams_that_come_and_go_are_no_change_of_exposure():
    """From one side dark things gleam, from another one bright things do."""
    views, places, points = capture(np.ones((N_VIEWS, 3)))
    phase = 2 * np.pi * np.arange(N_VIEWS) / N_VIEWS
    gleaming = []
    for view, dark, bright in zip(views, np.sin(phase), np.cos(phase), strict=True):
        light = np.where(view.image < 105, 1 + 0.15 * dark, 1 + 0.15 * bright)
        gleaming.append(View(view.camera, np.clip(view.image * light, 0, 255).astype(np.uint8)))
    found = estimate_exposure(gleaming, places, points)
    assert found.spread > 0.03
    assert found.error < found.spread / 10
    assert found.likeness < 0.5
    assert not found.varies
    assert estimate_exposure(*capture(drift(0.03))).likeness > 0.97


def test_too_few_points_are_no_evidence():
    views, places, points = capture(drift(0.25))
    few = estimate_exposure(views, [p[:19] for p in places], [p[:19] for p in points])
    assert not few.varies
    assert (few.gains == 1).all()
    none = estimate_exposure(views, [np.zeros((0, 2))] * N_VIEWS, [np.zeros(0, np.int64)] * N_VIEWS)
    assert not none.varies
    assert np.isinf(none.error)


def test_an_image_without_points_stays_as_it_is():
    gains = drift(0.25)
    views, places, points = capture(gains)
    places[3], points[3] = places[3][:5], points[3][:5]
    found = estimate_exposure(views, places, points)
    others = np.arange(N_VIEWS) != 3
    assert (found.gains[3] == 1).all()
    ratio = np.log(found.gains / gains)[others]
    assert np.abs(ratio - ratio.mean(axis=0)).max() < 0.006
    assert found.varies


def test_places_beyond_the_image_are_left_out():
    views, places, points = capture(drift(0.1))
    outside = [np.vstack([p, [[-3.0, 5.0], [1e9, 5.0], [5.0, 120.5]]]) for p in places]
    more = [np.append(p, [1, 2, 3]) for p in points]
    assert np.array_equal(estimate_exposure(views, outside, more).gains, estimate_exposure(views, places, points).gains)


def test_log_gains_are_the_least_squares_solution_where_nothing_is_wrong():
    rng = np.random.default_rng(3)
    rows, ids = np.repeat(np.arange(5), 40), np.concatenate([rng.permutation(60)[:40] for _ in range(5)])
    offsets = rng.normal(0, 0.1, 5)
    values = offsets[rows] + rng.normal(0, 1, 60)[ids]
    assert np.allclose(log_gains(values, rows, ids, 5), offsets - offsets.mean(), atol=1e-9)


def test_views_that_share_no_point_with_the_others_stay_finite():
    rows, ids = np.array([0, 0, 1, 1, 2, 2]), np.array([0, 1, 0, 1, 5, 6])
    found = log_gains(np.array([1.0, 2.0, 1.5, 2.5, 9.0, 9.0]), rows, ids, 3)
    assert np.isfinite(found).all()
    assert found[1] - found[0] == pytest.approx(0.5)


def test_corrected_views_look_as_if_nothing_had_changed():
    views, *_ = capture(drift(0.0), noise=0.0, seed=4)
    bright, *_ = capture(drift(0.2), noise=0.0, seed=4)
    gains = drift(0.2)
    for plain, changed, gain in zip(views, bright, gains, strict=True):
        assert np.abs(correct(changed, gain).image.astype(int) - plain.image).max() <= 1


def test_held_out_images_change_no_image_to_train_on():
    """Neither the decision nor the gains: a model must not learn from what it is judged by."""
    views, places, points = capture(drift(0.25))
    model = SparseModel(
        [view.camera for view in views],
        {view.camera.name: (place, ids) for view, place, ids in zip(views, places, points, strict=True)},
        (np.zeros(0, np.int64), np.zeros((0, 3))),
    )
    options = TrainOptions(exposure="auto", holdout=4)
    darker = [View(view.camera, view.image // 2) if i % 4 == 0 else view for i, view in enumerate(views)]
    plain, changed = (capture_of(given, model, None, None, options) for given in (views, darker))
    for one, other in zip(plain.training, changed.training, strict=True):
        assert np.array_equal(one.image, other.image)
    assert plain.effects.exposure.spread_pct == changed.effects.exposure.spread_pct
    ratio = np.array(changed.held_out_gains) / np.array(plain.held_out_gains)
    assert np.abs(ratio - 0.5).max() < 0.02


def test_gains_of_held_out_images_are_found_too():
    gains, fitted = drift(0.25), np.arange(N_VIEWS) % 4 != 0
    found = estimate_exposure(*capture(gains), fitted)
    ratio = np.log(found.gains / gains)
    assert np.abs(ratio - ratio[fitted].mean(axis=0)).max() < 0.008
    assert np.log(found.gains[fitted]).mean(axis=0) == pytest.approx(0, abs=1e-12)


def test_a_doubtful_spread_is_not_corrected():
    assert not Exposure(np.ones((2, 3)), 0.05, 0.02, 100).varies
    assert Exposure(np.ones((2, 3)), 0.05, 0.01, 100).varies
