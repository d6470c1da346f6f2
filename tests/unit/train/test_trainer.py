# SPDX-License-Identifier: Apache-2.0
"""The training loop on small scenes with a known answer."""

import dataclasses

import numpy as np
import pytest
from scenes.documents import effects
from scenes.training_scene import OPTIONS, quality_db, training_scene

from cotton3dg.core.scene import Gaussians
from cotton3dg.errors import StageFailed
from cotton3dg.gaussians.metrics import psnr_db, to_uint8
from cotton3dg.gaussians.rasterizer import StepReport, render
from cotton3dg.gaussians.views import View
from cotton3dg.geometry.camera_orbit import fit_orbit
from cotton3dg.train import densify, trainer
from cotton3dg.train.initialise import place_gaussians
from cotton3dg.train.quality import metrics_of, outcome_of
from cotton3dg.train.schedule import image_order, rate_factors
from cotton3dg.train.trainer import fit


def test_psnr_of_a_held_out_view_rises() -> None:
    start, views, held_out = training_scene()
    before = quality_db(start, held_out)
    result = fit(start, views, OPTIONS)
    assert quality_db(result.gaussians, held_out) > before + 5
    assert result.history[-1]["loss"] < 0.5 * result.history[0]["loss"]
    assert result.history[-1]["step"] == OPTIONS.steps
    assert result.rejected == []


def test_the_start_is_left_alone_and_two_runs_are_identical() -> None:
    start, views, _ = training_scene()
    before = start.sha256()
    options = dataclasses.replace(OPTIONS, steps=80)
    first, second = fit(start, views, options), fit(start, views, options)
    assert start.sha256() == before
    assert first.gaussians.sha256() == second.gaussians.sha256() != before
    other = fit(start, views, dataclasses.replace(options, seed=1))
    assert other.gaussians.sha256() != first.gaussians.sha256()


def test_the_budget_is_never_exceeded_and_is_used() -> None:
    start, views, _ = training_scene()
    counts = []
    options = dataclasses.replace(OPTIONS, max_gaussians=200)
    result = fit(start, views, options, watch=lambda step, gaussians: counts.append(len(gaussians)))
    assert len(counts) == options.steps
    assert max(counts) <= 200
    assert counts[0] == 150
    assert len(result.gaussians) > 180
    assert result.n_split > 0


def test_a_start_above_the_budget_is_refused() -> None:
    start, views, _ = training_scene()
    with pytest.raises(ValueError, match="budget of 100"):
        fit(start, views, dataclasses.replace(OPTIONS, max_gaussians=100))


def spoilt_steps(monkeypatch: pytest.MonkeyPatch, spoilt: set[int]) -> None:
    """Let the steps with these numbers end in a loss that is not finite."""
    honest, calls = trainer.train_step, iter(range(10**6))

    def step(gaussians, *arguments, **options):
        if next(calls) in spoilt:
            return StepReport(np.nan, np.nan, np.nan, 0, 0, {}, finite=False)
        return honest(gaussians, *arguments, **options)

    monkeypatch.setattr(trainer, "train_step", step)


def test_steps_with_a_non_finite_loss_are_counted_with_their_image(monkeypatch: pytest.MonkeyPatch) -> None:
    start, views, _ = training_scene()
    spoilt_steps(monkeypatch, {3, 17})
    result = fit(start, views, dataclasses.replace(OPTIONS, steps=40))
    order = image_order(len(views), 40, OPTIONS.seed)
    assert result.rejected == [(step, views[order[step]].camera.name) for step in (3, 17)]
    assert result.gaussians.finite_rows.all()
    assert all(np.isfinite(entry["loss"]) for entry in result.history)


def test_updates_that_were_skipped_are_counted_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    start, views, _ = training_scene()
    honest = trainer.train_step
    monkeypatch.setattr(trainer, "train_step", lambda *a, **k: dataclasses.replace(honest(*a, **k), n_skipped=2))
    result = fit(start, views, dataclasses.replace(OPTIONS, steps=40))
    assert result.n_skipped == 80
    assert result.rejected == []
    metrics = metrics_of(result, [], 1e-4)
    assert metrics.skipped_updates == 80
    assert "80 updates of single Gaussians" in outcome_of(metrics, effects()).warnings[0]


def test_too_many_rejected_steps_end_the_training(monkeypatch: pytest.MonkeyPatch) -> None:
    start, views, _ = training_scene()
    spoilt_steps(monkeypatch, set(range(5, 60)))
    with pytest.raises(StageFailed, match="not finite"):
        fit(start, views, dataclasses.replace(OPTIONS, steps=60))


def test_poisoned_gaussians_are_counted_and_dropped() -> None:
    start, views, held_out = training_scene()
    start.means[3, 1], start.log_scales[5, 0], start.sh[7, 0, 2] = np.nan, np.inf, np.nan
    result = fit(start, views, OPTIONS)
    assert result.culled["non_finite"] > 0
    assert result.n_pruned >= 3
    assert result.gaussians.finite_rows.all()
    assert quality_db(result.gaussians, held_out) > 20


def test_training_draws_what_judging_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Gaussian right in front of the camera, where the room is far: both or neither."""
    start, views, _ = training_scene()
    camera, rng = views[0].camera, np.random.default_rng(5)
    far = camera.centre + 40 * camera.forward + rng.normal(0, 5, (200, 3))
    near = camera.centre + 0.3 * camera.forward
    room = place_gaussians(np.vstack([far, near]), np.full((201, 3), 90, np.uint8), 0, 201, 0)
    start = densify.concatenate([start, room])
    honest, counts = trainer.train_step, []

    def step(gaussians, *arguments, **options):
        drawn = render(gaussians, camera, sh_degree=0).n_visible
        counts.append((honest(gaussians, *arguments, **options).n_visible, drawn))
        return StepReport(0, 0, 0, 0, 0, {}, finite=True)

    monkeypatch.setattr(trainer, "train_step", step)
    fit(start, views[:1], dataclasses.replace(OPTIONS, steps=1))
    assert counts[0][0] == counts[0][1] > 300


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_the_size_of_the_scene_does_not_matter(factor: float) -> None:
    start, views, held_out = training_scene()

    def scaled(view: View) -> View:
        pose = view.camera.cam_from_scene * np.array([1, 1, 1, factor])
        return View(dataclasses.replace(view.camera, cam_from_scene=pose), view.image)

    start = dataclasses.replace(
        start, means=start.means * np.float32(factor), log_scales=start.log_scales + np.float32(np.log(factor))
    )
    result = fit(start, [scaled(view) for view in views], OPTIONS)
    assert quality_db(result.gaussians, scaled(held_out)) > 20


@pytest.mark.parametrize("steps", [30, 40])
def test_a_training_of_three_epochs_uses_its_budget(steps: int) -> None:
    start, views, held_out = training_scene()
    result = fit(start, views, dataclasses.replace(OPTIONS, steps=steps))
    assert result.history[-1]["n_gaussians"] == OPTIONS.max_gaussians
    assert quality_db(result.gaussians, held_out) > quality_db(start, held_out) + 3
    assert outcome_of(metrics_of(result, [], 1e-4), effects()).warnings == ()


def test_a_training_too_short_for_its_budget_says_so() -> None:
    start, views, _ = training_scene()
    result = fit(start, views, dataclasses.replace(OPTIONS, steps=2))
    (warning,) = outcome_of(metrics_of(result, [], 1e-4), effects()).warnings
    assert "300 of the 400 Gaussians" in warning and "train.steps" in warning


def test_in_part_of_an_epoch_nothing_counts_as_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    start, views, _ = training_scene()
    asked = []
    monkeypatch.setattr(
        densify, "find_contributing", lambda weight, count: asked.append(1) or np.ones(len(count), bool)
    )
    fit(start, views, dataclasses.replace(OPTIONS, steps=11))
    assert not asked
    fit(start, views, dataclasses.replace(OPTIONS, steps=40))  # the steps after the last change are two epochs
    assert len(asked) == 1


def test_what_a_single_view_shows_stays() -> None:
    start, views, _ = training_scene()
    camera = views[0].camera
    upwards = np.column_stack([np.eye(3), -camera.centre])  # it shows nothing of the ball
    camera = dataclasses.replace(camera, name="up", cam_from_scene=upwards)
    rng = np.random.default_rng(4)
    wall = camera.centre + 3 * camera.forward + rng.normal(0, 0.3, (40, 3))
    lone = place_gaussians(wall, rng.integers(50, 256, (40, 3)).astype(np.uint8), 0, 40, 0)
    view = View(camera, to_uint8(render(lone, camera).image))
    result = fit(densify.concatenate([start, lone]), [*views, view], OPTIONS)
    assert quality_db(result.gaussians, view) > 25


def test_what_is_far_from_the_centre_takes_longer_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    start, views, _ = training_scene()
    orbit = fit_orbit([view.camera for view in views])
    honest, asked = trainer.train_step, []

    def step(gaussians, *arguments, rate_factors, **options):
        asked.append((gaussians.means.copy(), rate_factors))
        return honest(gaussians, *arguments, rate_factors=rate_factors, **options)

    monkeypatch.setattr(trainer, "train_step", step)
    fit(start, views, dataclasses.replace(OPTIONS, steps=499))
    assert all(factors is None for _, factors in asked)
    asked.clear()
    fit(start, views, dataclasses.replace(OPTIONS, steps=500))
    assert len(asked) == 500
    assert all(np.array_equal(factors, rate_factors(means, orbit)) for means, factors in asked)


def test_windows_cost_quality_nowhere_but_outside_of_them() -> None:
    start, views, held_out = training_scene()
    whole = fit(start, views, OPTIONS).gaussians
    windows = [(16, 0, 32, 48)] * len(views)
    windowed = fit(start, views, OPTIONS, windows=windows).gaussians
    inside = np.zeros((48, 64), bool)
    inside[:, 16:48] = True

    def error_db(gaussians: Gaussians) -> float:
        return psnr_db(to_uint8(render(gaussians, held_out.camera).image), held_out.image, inside)

    assert error_db(windowed) > error_db(whole) - 0.5
    assert not np.array_equal(windowed.means[: len(whole.means)], whole.means[: len(windowed.means)])
