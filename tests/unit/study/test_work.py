# SPDX-License-Identifier: Apache-2.0
"""Settings side by side: what is shared, skipped, resumed and told; with small stages in place of the real ones."""

import csv
import math
from collections import Counter

import pytest
from scenes.documents import train_metrics
from scenes.small_stages import filmed_plant, replace_stages

from cotton3dg import pipeline
from cotton3dg.core.runs import StageOutcome
from cotton3dg.errors import BadUsage, CaptureFailed
from cotton3dg.stage import Footage, Stage, stage_of
from cotton3dg.study import work
from cotton3dg.study.rows import empty_row
from cotton3dg.study.settings import sweeps_of
from cotton3dg.study.tables import ERRORS

VIDEO = Footage(120, 1280, 720)
READS = {
    "frames": [], "sfm": ["frames"], "train": ["sfm"], "masks": ["sfm"], "segment": ["train", "masks"],
    "cluster": ["segment"], "scale": ["train"], "traits": ["cluster", "scale"],
}  # fmt: skip


class Stages:
    """Each stage notes that it ran, and writes its option that matters here and what it read."""

    def __init__(self):
        self.ran, self.interrupt_after, self.fail = [], math.inf, lambda options: False

    def make(self, stage):
        def inputs(workspace):
            return [workspace.folder(source) for source in READS[stage]] or [workspace.capture()]

        def run(workspace, options, progress):
            if len(self.ran) >= self.interrupt_after:
                raise KeyboardInterrupt
            if self.fail(options):
                raise CaptureFailed("too dark; film again")
            self.ran.append(stage)
            read = [(workspace.folder(source) / "out.txt").read_text() for source in READS[stage]]
            return written(workspace, stage, f"{stage} {options} {read}")

        return Stage(stage, 1, inputs, run, stage_of(stage).cost)

    def save_intermediate_models(self, workspace, options, targets, progress):
        self.ran.append("training")
        return {steps: written(target, "train", f"model after {steps}") for steps, target in targets.items()}


def written(workspace, stage, text):
    with workspace.writing(stage) as folder:
        (folder / "out.txt").write_text(text)
        train_metrics().save(folder / "metrics.json")
    return StageOutcome({"n": 1})


def figures(setting):
    """A row as if measured: finer settings take longer and are better."""
    finer = float(setting) if setting.isdecimal() else 5.0
    row = {"full_psnr_db": 20 + finer, "seconds": 10 * finer + 10, "idle_seconds": 10 * finer + 5, "psnr_db": 30.0}
    row |= dict.fromkeys(ERRORS, 100.0 + finer)
    return row | {"cpu_seconds": 2 * row["idle_seconds"], "trait_error_pct": 0.0}


@pytest.fixture
def stages(monkeypatch):
    stages = Stages()
    replace_stages(monkeypatch, stages.make)
    monkeypatch.setattr(work, "save_intermediate_models", stages.save_intermediate_models)
    monkeypatch.setattr(work, "examine_footage", lambda plant: VIDEO)
    monkeypatch.setattr(
        work,
        "finished_row",
        lambda folder, sweep, setting, options, regions, lpips: empty_row(sweep, setting, "done") | figures(setting),
    )
    return stages


@pytest.fixture
def plant(tmp_path):
    return filmed_plant(tmp_path)


def study(plant, sweeps, **keywords):
    said = []
    made = work.Study(plant, tell=said.append, **keywords)
    return {(row["sweep"], row["setting"]): row for row in made.run(sweeps_of(sweeps))}, said


def test_stages_that_a_setting_does_not_touch_run_once(plant, stages):
    rows, _ = study(plant, ["sh=0,2", "views=8"])
    assert set(rows) == {
        ("base", "draft"), ("sh", "0"), ("sh", "2"), ("sh", "3"), ("views", "8"), ("views", "24"),
    }  # fmt: skip
    assert {row["state"] for row in rows.values()} == {"done"}
    assert Counter(stages.ran) == {
        "frames": 1, "sfm": 1, "train": 3, "masks": 2, "segment": 4, "cluster": 4, "scale": 3, "traits": 4,
    }  # fmt: skip
    # The base stands in each sweep under its own value.
    assert rows["sh", "3"]["seconds"] == rows["views", "24"]["seconds"] == rows["base", "draft"]["seconds"]


def test_what_the_plants_own_run_has_finished_is_not_repeated(plant, stages):
    pipeline.run(plant, pipeline.stage_options(plant, "draft"))
    before = plant.hashes(*(plant.folder(stage) for stage in pipeline.STAGES))
    stages.ran.clear()
    study(plant, ["views=8"])
    assert stages.ran == ["masks", "segment", "cluster", "traits"]
    assert plant.hashes(*(plant.folder(stage) for stage in pipeline.STAGES)) == before


def test_each_setting_gets_what_was_made_from_its_own_images(plant, stages):
    pipeline.run(plant, pipeline.stage_options(plant))
    stages.ran.clear()
    # The cameras of both presets have the same options, but other images.
    rows, _ = study(plant, ["preset=standard"])
    assert stages.ran == list(pipeline.STAGES)
    assert rows["preset", "standard"]["state"] == "done"


@pytest.mark.parametrize("after", [0, 9, 14])
def test_an_interrupted_study_resumes(plant, stages, tmp_path, after):
    stages.interrupt_after = after
    with pytest.raises(KeyboardInterrupt):
        study(plant, ["sh=0,2", "views=8"])
    stages.interrupt_after = math.inf
    resumed, _ = study(plant, ["sh=0,2", "views=8"])
    assert Counter(stages.ran)["sfm"] == 1 and len(stages.ran) == 22
    _, said = study(plant, ["sh=0,2", "views=8"])
    assert len(stages.ran) == 22 and said == ["sh 0: finished", "sh 2: finished", "views 8: finished"]
    with plant.study_csv.open(newline="") as file:
        assert [(row["sweep"], row["setting"]) for row in csv.DictReader(file)] == list(resumed)


def test_the_tables_are_right_after_each_setting(plant, stages):
    stages.interrupt_after = 13  # in the second setting after the base
    with pytest.raises(KeyboardInterrupt):
        study(plant, ["sh=0,2"])
    with plant.study_csv.open(newline="") as file:
        assert [(row["sweep"], row["setting"]) for row in csv.DictReader(file)] == [
            ("base", "draft"), ("sh", "0"),
        ]  # fmt: skip
    assert "Degree of the view-dependent colour" in plant.study_md.read_text()
    assert plant.study_plot.stat().st_size > 1000


def test_a_setting_that_fails_leaves_the_others(plant, stages):
    stages.fail = lambda options: getattr(options, "sh_degree", 1) == 0
    rows, _ = study(plant, ["sh=0,2"])
    assert rows["sh", "0"]["state"] == "failed" and "too dark" in rows["sh", "0"]["reason"]
    assert rows["sh", "2"]["state"] == "done"
    assert "0: failed, too dark; film again." in plant.study_md.read_text()


def test_a_base_that_fails_is_the_studys_failure(plant, stages):
    stages.fail = lambda options: True
    with pytest.raises(CaptureFailed, match="too dark"):
        study(plant, ["sh"])


def test_what_does_not_fit_into_the_time_is_skipped_and_told(plant, stages, monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(work.time, "monotonic", lambda: clock[0])
    made = work.Study(plant, budget_s=1000.0, tell=lambda text: None)
    run = pipeline.run

    def timed(workspace, *arguments, **keywords):
        clock[0] += 300.0
        run(workspace, *arguments, **keywords)

    monkeypatch.setattr(work.pipeline, "run", timed)
    monkeypatch.setattr(made, "_stage_s", lambda setting, stage: 40.0)
    rows = {row["setting"]: row for row in made.run({"sh": ("0", "1", "2")}) if row["sweep"] == "sh"}
    # Five stages, 200 s, are expected of each; after the base and two of 300 s there are 100 s left.
    assert [rows[value]["state"] for value in "0123"] == ["done", "done", "skipped", "done"]
    assert rows["2"]["reason"] == "about 3.3 min needed, 1.7 min left"


def test_a_time_that_is_too_short_for_the_base_is_told(plant, stages):
    with pytest.raises(BadUsage, match="base setting alone"):
        study(plant, ["sh"], budget_s=5.0)
    assert stages.ran == []


def test_times_are_told_from_those_measured(plant, stages):
    made = work.Study(plant)
    first = made._stage_s(made.base, "train")
    made.timed["train"] += [(3 * first, first)] * 2
    assert made._stage_s(made.base, "train") == pytest.approx(3 * first)


def test_steps_come_from_one_training(plant, stages):
    rows, _ = study(plant, ["steps=50,100"])
    assert [key for key in rows if key[0] == "steps"] == [("steps", "50"), ("steps", "100"), ("steps", "1500")]
    assert Counter(stages.ran)["training"] == 1 and Counter(stages.ran)["train"] == 1
    passed = plant.study_setting("steps", "50")
    assert (passed.folder("train") / "out.txt").read_text() == "model after 50"
    assert "model after 50" in (passed.folder("segment") / "out.txt").read_text()
    assert passed.read_record("train").seconds == 2.0
    done = len(stages.ran)
    study(plant, ["steps=50,100"])
    assert len(stages.ran) == done


def test_more_steps_than_the_base_has_come_from_one_longer_training(plant, stages):
    rows, _ = study(plant, ["steps=2000,9000,100", "sh=0,3"])
    assert [key[1] for key in rows if key[0] == "steps"] == ["100", "2000", "9000"]
    assert Counter(stages.ran)["training"] == 1 and Counter(stages.ran)["train"] == 2  # base and sh=0
    for steps in ("100", "2000", "9000"):
        passed = plant.study_setting("steps", steps)
        assert (passed.folder("train") / "out.txt").read_text() == f"model after {steps}"
        assert passed.read_record("train").options["steps"] == 9000
    assert "model after" not in (plant.study_setting("base", "draft").folder("train") / "out.txt").read_text()
    done = len(stages.ran)
    study(plant, ["steps=100,2000,9000"])
    assert len(stages.ran) == done
