# SPDX-License-Identifier: Apache-2.0
"""The cost model, and what fits into a time."""

from itertools import pairwise

import pytest

from cotton3dg import pipeline
from cotton3dg.errors import BadUsage
from cotton3dg.planning import time_budget
from cotton3dg.planning.cost import Machine, estimate_costs, sum_seconds
from cotton3dg.planning.time_budget import LADDER, BudgetInfo, choose, explain
from cotton3dg.schemas.record import Record
from cotton3dg.stage import Cost, Footage
from cotton3dg.workspace import Workspace

VIDEO = Footage(120, 1280, 720)
MACHINE = Machine(2)


def options(preset="standard", **train):
    return pipeline.stage_options(None, preset, {"train": train})


def total(chosen, source=VIDEO, machine=MACHINE):
    return sum_seconds(estimate_costs(chosen, source, machine), machine.cores)


def test_every_stage_costs_something():
    by_stage = estimate_costs(options(), VIDEO, MACHINE)
    assert by_stage.keys() == {*pipeline.STAGES, "report"}
    assert all(cost.cpu_s > 0 for cost in by_stage.values())


@pytest.mark.parametrize(
    "less, more",
    [
        ({"steps": 1000}, {"steps": 2000}),
        ({"max_side": 480}, {"max_side": 960}),
        ({"max_gaussians": 50_000}, {"max_gaussians": 100_000}),
        ({"sh_degree": 0}, {"sh_degree": 3}),
    ],
)
def test_more_work_takes_longer(less, more):
    assert total(options(**less)) < total(options(**more))


def test_images_cannot_be_more_than_the_video_has():
    assert total(options(), Footage(50, 1280, 720)) < total(options())
    many = pipeline.stage_options(None, overrides={"frames": {"count": 500}})
    assert total(many) == pytest.approx(total(pipeline.stage_options(None, overrides={"frames": {"count": 120}})))


def test_the_bolls_network_sees_small_images_large():
    """So masks of a video of half the size take as long; those of other back ends do not."""
    for backend, least in (("bolls", 0.7), ("yolo", 0.25)):
        chosen = pipeline.stage_options(None, overrides={"masks": {"backend": backend}})
        small, large = (
            estimate_costs(chosen, Footage(120, w, h), MACHINE)["masks"] for w, h in ((640, 360), (1280, 720))
        )
        assert least < small.cpu_s / large.cpu_s < least + 0.35


def test_a_slower_machine_and_fewer_cores_take_longer():
    assert total(options(), machine=Machine(1)) > 1.6 * total(options())
    assert total(options(), machine=Machine(2, 2.0, 2.0)) == pytest.approx(2 * total(options()))
    only_splatting = estimate_costs(options(), VIDEO, Machine(2, splatting=3.0))
    assert only_splatting["sfm"] == estimate_costs(options(), VIDEO, MACHINE)["sfm"]
    assert only_splatting["train"].cpu_s == pytest.approx(3 * estimate_costs(options(), VIDEO, MACHINE)["train"].cpu_s)


def test_work_that_one_core_must_do_is_not_shared():
    assert Cost(10.0, 3.0).seconds(2) == 8.0
    assert Cost(10.0, 3.0).cpu_s == 13.0


def resolve(values):
    return pipeline.stage_options(None, chosen=values)


@pytest.mark.parametrize("budget_s", [100, 120, 300, 600, 3600])
def test_what_is_chosen_fits_and_uses_the_time(budget_s):
    choice = choose(budget_s, resolve, VIDEO, MACHINE)
    assert choice.expected_s <= budget_s
    assert choice.expected_s == pytest.approx(total(choice.options))
    # Between two rungs some time may be left; never as much as half.
    assert choice.expected_s > 0.5 * budget_s


def test_more_time_never_gives_less():
    chosen = [choose(budget_s, resolve, VIDEO, MACHINE) for budget_s in range(90, 4000, 200)]
    rungs = [LADDER.index(choice.rung) for choice in chosen]
    assert rungs == sorted(rungs, reverse=True)
    for before, after in pairwise(chosen):
        if before.rung is after.rung:
            assert before.options["train"].steps <= after.options["train"].steps


def test_what_the_user_gave_wins():
    def with_steps(values):
        return pipeline.stage_options(None, overrides={"train": {"steps": "700"}}, chosen=values)

    choice = choose(600, with_steps, VIDEO, MACHINE)
    assert choice.options["train"].steps == 700
    assert choice.expected_s <= 600


def test_a_toml_of_the_plant_wins(tmp_path):
    (tmp_path / "cotton3dg.toml").write_text("[frames]\ncount = 33\n")

    def with_file(values):
        return pipeline.stage_options(Workspace(tmp_path), chosen=values)

    assert choose(600, with_file, VIDEO, MACHINE).options["frames"].count == 33


def test_a_time_that_is_too_short_is_told():
    with pytest.raises(BadUsage, match="longer --time-budget"):
        choose(10, resolve, VIDEO, MACHINE)


def test_time_that_cameras_took_is_taken_from_the_steps():
    first = choose(250, resolve, VIDEO, MACHINE)
    slow = choose(250, resolve, VIDEO, MACHINE, {"frames": 10.0, "sfm": 110.0}, ladder=(first.rung,))
    quick = choose(250, resolve, VIDEO, MACHINE, {"frames": 3.0, "sfm": 12.0}, ladder=(first.rung,))
    assert slow.options["train"].steps <= first.options["train"].steps < quick.options["train"].steps
    assert quick.expected_s <= 250


def test_cameras_that_took_all_the_time_leave_the_least_steps():
    first = choose(250, resolve, VIDEO, MACHINE)
    late = choose(250, resolve, VIDEO, MACHINE, {"frames": 10.0, "sfm": 500.0}, ladder=(first.rung,))
    assert late.options["train"].steps == first.rung.least


def test_the_line_tells_what_is_given_up():
    line = explain(choose(120, resolve, VIDEO, MACHINE), 120)
    assert line.startswith("time budget 2.0 min: ")
    assert "30,000 steps" in line.split("gives up")[1]


class Recorded:
    """Stands in for the pipeline: notes what it is asked for and leaves records."""

    def __init__(self, seconds):
        self.seconds, self.calls = seconds, []

    def run(self, workspace, options, stages=pipeline.STAGES, **keywords):
        self.calls.append((stages, options))
        for stage in stages:
            workspace.write_record(Record(stage, seconds=self.seconds))


def test_a_budget_runs_the_cameras_then_fits_the_steps(tmp_path, monkeypatch):
    from cotton3dg.workspace import Workspace

    monkeypatch.setattr(time_budget, "examine_footage", lambda workspace: VIDEO)
    said, recorded = [], Recorded(60.0)
    monkeypatch.setattr(time_budget.pipeline, "run", recorded.run)
    workspace = Workspace(tmp_path)
    budget = time_budget.Budget(workspace, 300, MACHINE, tell=said.append)
    before = budget.choice.options["train"].steps
    budget.run()
    (early, first), (late, second) = recorded.calls
    assert early + late == pipeline.STAGES and early[-1] == "sfm"
    assert first["frames"] == second["frames"] and second["train"].steps != before
    assert len(said) == 2 and "cameras took" in said[1]
    record = BudgetInfo.load(workspace.record_file("time_budget"))
    assert record.budget_s == 300 and record.expected_s == pytest.approx(budget.choice.expected_s)
    budget.run()
    assert recorded.calls[-1][1] == second  # the same seconds are on record, so the same is chosen
