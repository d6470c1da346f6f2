# SPDX-License-Identifier: Apache-2.0
"""Hard case 53: options at and beyond the ends of what they accept, intervals of zero among them."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from scenes.training_scene import OPTIONS, training_scene

from cotton3dg.errors import BadUsage
from cotton3dg.gaussians.views import hold_out
from cotton3dg.option_rules import places
from cotton3dg.options import STAGE_OPTIONS, SimulateOptions, TrainOptions, resolve
from cotton3dg.train.schedule import densification_steps
from cotton3dg.train.trainer import RECORDED_EVERY, fit

BOUNDS = [
    (stage, place, place.item.metadata[end], -1 if end == "at_least" else 1)
    for stage, kind in (STAGE_OPTIONS | {"simulate": SimulateOptions}).items()
    for place in places(kind)
    for end in ("at_least", "at_most")
    if place.item.metadata[end] is not None
]


@pytest.mark.parametrize(("stage", "place", "bound", "outwards"), BOUNDS)
def test_case_53_the_bound_is_accepted_and_what_lies_beyond_is_refused(stage, place, bound, outwards) -> None:
    kind = place.kind
    assert place.value_in(resolve(stage, {place.path: kind(bound)})) == bound
    beyond = kind(bound) + outwards if kind is int else np.nextafter(kind(bound), outwards * np.inf).item()
    with pytest.raises(BadUsage, match=rf"{stage}\.{place.path}"):
        resolve(stage, {place.path: beyond})


@pytest.mark.parametrize(
    ("stage", "name"),
    [(stage, place.path) for stage, kind in STAGE_OPTIONS.items() for place in places(kind) if place.kind is float],
)
@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_case_53_numbers_that_are_not_finite_are_refused(stage, name, value) -> None:
    with pytest.raises(BadUsage, match=rf"{stage}\.{name}"):
        resolve(stage, {name: value})


def test_case_53_every_number_has_a_lower_bound() -> None:
    unbounded = [
        f"{stage}.{place.path}"
        for stage, kind in STAGE_OPTIONS.items()
        for place in places(kind)
        if place.kind in (int, float) and place.item.metadata["at_least"] is None
    ]
    assert unbounded == []


@pytest.mark.parametrize(("every", "held"), [(0, 0), (1, 0), (2, 3), (5, 1), (6, 1), (1000, 1)])
def test_case_53_holding_out_every_zeroth_or_first_image_leaves_something_to_train_on(every, held) -> None:
    _, views, _ = training_scene(5)
    training, held_out = hold_out(views, every)
    assert len(held_out) == held
    assert len(training) == 5 - held


@pytest.mark.parametrize("steps", [1, 2, RECORDED_EVERY - 1, RECORDED_EVERY])
@pytest.mark.parametrize("n_views", [1, 3])
def test_case_53_the_shortest_trainings_end(steps, n_views) -> None:
    start, views, _ = training_scene(n_views)
    result = fit(start, views, replace(OPTIONS, steps=steps))
    assert result.history[-1]["step"] == steps
    assert result.gaussians.finite_rows.all()
    assert densification_steps(steps, n_views).step > 0


def test_case_53_the_smallest_budget_is_that_of_the_start() -> None:
    start, views, _ = training_scene(3)
    least = next(item for item in fields(TrainOptions) if item.name == "max_gaussians").metadata["at_least"]
    result = fit(start[:least], views, replace(OPTIONS, steps=30, max_gaussians=least))
    assert 0 < len(result.gaussians) <= least
