# SPDX-License-Identifier: Apache-2.0
"""What runs, what is up to date and why: with small stages that stand in for the real ones."""

import json
import logging
import sys
from dataclasses import replace

import pytest
from scenes.small_stages import MODULES, copying_stage, filmed_plant, replace_stages

from cotton3dg import pipeline
from cotton3dg.core.runs import State
from cotton3dg.core.usage import peak_memory_mib
from cotton3dg.errors import (
    BadInput,
    BadUsage,
    CaptureFailed,
    Cotton3dgError,
    EnvironmentUnusable,
    MissingInput,
    OutOfResources,
    StageFailed,
)
from cotton3dg.masks import stage as masks
from cotton3dg.option_rules import places
from cotton3dg.options import STAGE_OPTIONS
from cotton3dg.schemas.record import Record
from cotton3dg.stage import stage_of
from cotton3dg.staleness import recorded_states, stale_reason
from cotton3dg.workspace import Workspace

NAMES_OF = {stage: stage_of(stage).names for stage in pipeline.STAGES}


class Recorder(pipeline.Watcher):
    def __init__(self):
        self.ran, self.kept = [], []

    def finished(self, step, record):
        self.ran.append(step.stage)

    def skipped(self, step):
        self.kept.append(step.stage)


@pytest.fixture
def stages(monkeypatch):
    """Stages that each copy the text of the one before; returns what changes one of them."""
    replace_stages(monkeypatch, copying_stage)

    def change(stage, **parts):
        monkeypatch.setattr(MODULES[stage], "STAGE", replace(stage_of(stage), **parts))

    return change


@pytest.fixture
def workspace(tmp_path):
    return filmed_plant(tmp_path)


def run(workspace, stages=pipeline.STAGES, overrides=None, **keywords):
    watcher = Recorder()
    pipeline.run(workspace, pipeline.stage_options(workspace, overrides=overrides), stages, watcher=watcher, **keywords)
    return watcher


def test_a_notebook_hears_its_own_logging_again_after_a_run(workspace, stages):
    log = logging.getLogger("cotton3dg")
    before = log.level, log.propagate, list(log.handlers)
    log.setLevel(logging.WARNING)
    log.propagate = True
    try:
        run(workspace)
        assert (log.level, log.propagate, list(log.handlers)) == (logging.WARNING, True, before[2])
    finally:
        log.setLevel(before[0])
        log.propagate = before[1]


def test_the_second_run_does_nothing(workspace, stages):
    assert run(workspace).ran == list(pipeline.STAGES)
    assert run(workspace).kept == list(pipeline.STAGES)


def test_a_changed_option_runs_its_stage_and_what_its_result_changes(workspace, stages):
    run(workspace)
    again = run(workspace, overrides={"cluster": {"method": "dbscan"}})
    assert again.ran == ["cluster"]  # it made the same file again, so nothing after it is stale


def test_an_option_that_is_younger_than_a_result_had_its_default(workspace, stages):
    run(workspace)
    record = workspace.read_record("train")
    older = {name: value for name, value in record.options.items() if name not in ("start", "model")}
    workspace.write_record(replace(record, options=older))
    assert run(workspace).ran == []
    options = pipeline.stage_options(workspace, overrides={"train": {"start": "points"}})
    assert stale_reason(workspace, "train", options["train"]) == "option start dense -> points"


def test_a_changed_input_runs_until_a_result_stays_the_same(workspace, stages):
    run(workspace)
    (workspace.root / "video.mp4").write_text("other video")
    assert run(workspace).ran == list(pipeline.STAGES[: pipeline.STAGES.index("scale") + 1])


@pytest.mark.parametrize(
    "damage, reason",
    [
        (lambda w: (w.folder("sfm") / "out.txt").write_text("bit rot"), "output sfm/out.txt changed"),
        (lambda w: (w.folder("sfm") / "out.txt").unlink(), "output sfm/out.txt is missing"),
        (lambda w: (w.folder("sfm") / "new.txt").touch(), "output sfm/new.txt is new"),
        (lambda w: w.record_file("sfm").unlink(), "no finished result"),
        (lambda w: w.record_file("sfm").write_text("{"), "no finished result"),
    ],
)
def test_damage_is_noticed_and_repaired(workspace, stages, damage, reason):
    run(workspace)
    damage(workspace)
    assert stale_reason(workspace, "sfm", pipeline.stage_options(workspace)["sfm"]) == reason
    assert run(workspace).ran == ["sfm"]


def test_a_renamed_plant_gets_its_new_name_into_the_tables(workspace, stages):
    run(workspace)
    renamed = Workspace(workspace.root.rename(workspace.root.with_name("plant_008")))
    again = run(renamed)
    assert again.ran == ["traits"]
    assert renamed.read_record("traits").options["plant_id"] == "plant_008"
    assert run(renamed, overrides={"traits": {"plant_id": "A-17"}}).ran == ["traits"]


def test_a_network_trained_anew_under_its_old_name_runs_the_masks(workspace, stages, tmp_path):
    weights, overrides = tmp_path / "best.onnx", {"masks": {"weights": str(tmp_path / "best.onnx")}}
    stages("masks", names=masks.NAMES, also_reads=masks.also_reads)
    weights.write_text("trained on ten images")
    run(workspace, overrides=overrides)
    assert run(workspace, overrides=overrides).ran == []
    weights.write_text("trained on a hundred images")
    reason = stale_reason(workspace, "masks", pipeline.stage_options(workspace, overrides=overrides)["masks"])
    assert reason == f"input {weights} changed"
    assert run(workspace, overrides=overrides).ran == ["masks"]


@pytest.mark.parametrize("chosen", ["lift", "probability"])
def test_only_options_of_the_chosen_method_make_a_result_stale(workspace, stages, chosen):
    workspace.options_file.write_text(f'[segment]\nmethod = "{chosen}"\n')
    run(workspace)
    assert ("threshold" in workspace.read_record("segment").options) == (chosen == "probability")
    with workspace.options_file.open("a") as file:
        file.write("[segment.affinity]\nfeatures = 8\n[segment.probability]\nthreshold = 0.9\n")
    options = pipeline.stage_options(workspace)["segment"]
    assert stale_reason(workspace, "segment", options) == ("" if chosen == "lift" else "option threshold 0.75 -> 0.9")


def test_a_record_that_has_the_options_of_all_methods_is_still_up_to_date(workspace, stages):
    run(workspace)
    record = workspace.read_record("segment")
    others = {"threshold": 0.75, "steps": 7000, "views": 4, "features": 16, "seed": 0}
    workspace.write_record(replace(record, options=record.options | others))
    assert run(workspace).ran == []
    reason = stale_reason(
        workspace, "segment", pipeline.stage_options(workspace, overrides={"segment": {"target": 1}})["segment"]
    )
    assert reason == "option target 0 -> 1"


def test_a_new_version_of_a_stage_runs_it(workspace, stages):
    run(workspace)
    stages("train", version=2)
    assert run(workspace).ran == ["train"]


def test_plan_names_the_first_reason_and_its_consequences(workspace, stages):
    run(workspace)
    options = pipeline.stage_options(workspace, overrides={"train": {"steps": 7}})
    reasons = {step.stage: step.reason for step in pipeline.plan(workspace, options, pipeline.STAGES)}
    assert reasons["sfm"] == ""
    assert reasons["train"] == "option steps 2500 -> 7"
    assert reasons["scale"] == "after train"


def test_a_stage_that_reads_nothing_of_a_stale_one_is_up_to_date(workspace, stages):
    run(workspace)
    stages("masks", inputs=lambda workspace: [workspace.folder("train") / "out.txt"])
    pipeline.run(workspace, pipeline.stage_options(workspace), ("masks",))
    options = pipeline.stage_options(workspace, overrides={"scale": {"table_length_cm": 100}})
    reasons = {step.stage: step.reason for step in pipeline.plan(workspace, options, pipeline.STAGES)}
    assert reasons["scale"] == "option table_length_cm 0.0 -> 100.0"
    assert reasons["masks"] == reasons["segment"] == reasons["traits"] == ""


def test_what_killed_runs_left_goes_with_the_next_run_even_if_that_does_nothing(workspace, stages):
    run(workspace)
    for name in (".sfm.partial", ".train.old"):
        (workspace.root / name / "images").mkdir(parents=True)
    assert run(workspace).ran == []
    assert not list(workspace.root.glob(".*.*"))


def test_from_until_and_force(workspace, stages):
    run(workspace)
    assert run(workspace, pipeline.selected("train", "segment"), force=True).ran == [
        "train",
        "scale",
        "masks",
        "segment",
    ]
    with pytest.raises(BadUsage, match="no stage lies"):
        pipeline.selected("traits", "frames")
    with pytest.raises(BadUsage, match="unknown"):
        pipeline.selected("frames", "harvest")


@pytest.mark.parametrize(
    "raised, error, code",
    [
        (CaptureFailed("too dark; film again"), CaptureFailed, 4),
        (MemoryError(), OutOfResources, 7),
        (ZeroDivisionError("division"), StageFailed, 1),
    ],
)
def test_a_failure_is_recorded_and_costs_one_stage(workspace, stages, raised, error, code):
    def fail(workspace, options, progress):
        with workspace.writing("train"):
            raise raised

    working = stage_of("train").run
    stages("train", run=fail)
    with pytest.raises(error):
        run(workspace)
    record = workspace.read_record("train")
    assert record.status == "failed"
    assert record.exit_code == code
    assert record.error
    assert "train failed" in workspace.log_file.read_text()
    states = {item.stage: item.state for item in pipeline.status(workspace, pipeline.stage_options(workspace))}
    assert (states["sfm"], states["train"], states["masks"]) == (State.DONE, State.FAILED, State.MISSING)
    assert states == {item.stage: item.state for item in recorded_states(workspace)}
    stages("train", run=working)
    assert run(workspace).kept == ["frames", "sfm"]


def tree(workspace):
    return {path: path.read_bytes() for path in sorted(workspace.root.rglob("*")) if path.is_file()}


@pytest.mark.parametrize(
    "stage, values, named",
    [
        ("masks", {"bolls.weights": "/no/such.onnx"}, r"masks\.bolls\.weights = '/no/such\.onnx' is not there"),
        ("masks", {"bolls.weights": "frames"}, r"masks\.bolls\.weights = .*frames' is a folder; give a file"),
        ("masks", {"backend": "import", "source": "nosuch"}, r"masks\.import\.source = 'nosuch' is not there"),
        ("masks", {"backend": "sam", "weights": "frames", "prompts": "p.csv"}, r"masks\.sam\.prompts = 'p\.csv'"),
        (
            "masks",
            {"backend": "grounded-sam", "detector": "run.log"},
            r"detector = .*run\.log' is a file; give a folder",
        ),
        ("train", {"model": "nosuch.ply"}, r"train\.model = 'nosuch\.ply' is not there"),
        ("traits", {"weight_model": "w.json"}, r"traits\.weight_model = 'w\.json' is not there"),
    ],
)
@pytest.mark.parametrize("whole", [True, False])
def test_a_mistyped_file_touches_nothing(workspace, stages, stage, values, named, whole):
    for name, names in NAMES_OF.items():
        stages(name, names=names)
    run(workspace, report=True)
    before = tree(workspace)
    with pytest.raises((MissingInput, BadInput), match=named):
        run(workspace, pipeline.STAGES if whole else (stage,), {stage: values, "frames": {"count": 70}}, report=True)
    assert tree(workspace) == before


def test_every_option_that_is_a_path_is_known():
    words = {"masks": {"classes", "prompt"}, "scale": {"board", "patches"}, "traits": {"plant_id"}}
    for stage, kind in STAGE_OPTIONS.items():
        free = {place.path for place in places(kind) if place.kind is str and not place.item.metadata["choices"]}
        assert free - {path for path in free if path.split(".")[-1] in words.get(stage, ())} == set(NAMES_OF[stage])


def test_a_stage_out_of_order_writes_nothing(workspace, stages):
    with pytest.raises(MissingInput, match=r"scale/out\.txt is missing; run `cotton3dg scale` first"):
        run(workspace, ("masks",), report=True)
    with pytest.raises(MissingInput, match="cotton3dg sfm"):
        run(workspace, pipeline.selected("train"), report=True)
    assert [path.name for path in tree(workspace)] == ["video.mp4"]


def test_without_a_film_nothing_is_written(workspace, stages):
    workspace.capture().unlink()
    for wait in (True, False):
        with pytest.raises(MissingInput, match="no video"):
            run(workspace, report=True, wait=wait)
    assert not tree(workspace)


@pytest.mark.parametrize(
    "error, recorded",
    [
        (BadUsage("no distance; add --distance-cm"), False),
        (BadInput("own.onnx holds no network; give another"), False),
        (MissingInput("bolls.json is missing; run cluster"), False),
        (EnvironmentUnusable("ultralytics is missing; install it"), False),
        (CaptureFailed("too dark; film again"), True),
        (ZeroDivisionError("division"), True),
    ],
)
def test_a_mistake_that_a_stage_finds_leaves_what_is_finished(workspace, stages, error, recorded):
    def fail(workspace, options, progress):
        raise error

    run(workspace, report=True)
    before = tree(workspace)
    stages("masks", run=fail)
    with pytest.raises(Cotton3dgError):
        run(workspace, ("masks",), {"masks": {"views": 7}}, report=True)
    changed = {path.name for path, content in tree(workspace).items() if before.get(path) != content}
    assert changed == ({"run.log", "masks.json", "options.json", "report.json", "report.html"} if recorded else set())


def test_a_stage_that_the_disk_has_no_room_for_leaves_what_is_finished(workspace, stages):
    run(workspace, report=True)
    before = tree(workspace)
    stages("masks", disk_bytes=lambda workspace, options: 2.0**62)
    with pytest.raises(OutOfResources, match="of disk"):
        run(workspace, ("masks",), force=True, report=True)
    assert {path.name for path, content in tree(workspace).items() if before.get(path) != content} == {"run.log"}


@pytest.mark.parametrize("error", [BadUsage("no distance"), CaptureFailed("too dark")])
def test_what_never_was_finished_has_failed(workspace, stages, error):
    def fail(workspace, options, progress):
        raise error

    stages("masks", run=fail)
    with pytest.raises(Cotton3dgError):
        run(workspace, report=True)
    assert workspace.read_record("masks").status == "failed"
    assert str(error) in workspace.report_html.read_text()


def test_a_second_process_is_turned_away(workspace, stages):
    with workspace.locked(), pytest.raises(EnvironmentUnusable, match="another"):
        run(workspace)


@pytest.mark.skipif(sys.platform != "linux", reason="measured by means of Linux alone")
def test_a_stage_is_not_charged_with_what_others_have_freed(workspace, stages):
    # 200 MB in pieces that the allocator keeps, as the last of them is in use.
    kept = [b"%04d" % i * 12_500 for i in range(4_000)]
    before = peak_memory_mib()
    del kept[:-1]
    run(workspace)
    assert workspace.read_record("frames").peak_memory_mib < before - 100


def test_the_record_tells_what_was_done(workspace, stages):
    run(workspace)
    record = workspace.read_record("frames")
    assert record.inputs.keys() == {"video.mp4"}
    assert record.outputs.keys() == {"frames/out.txt"}
    assert record.options["count"] == pipeline.stage_options(workspace)["frames"].count
    assert record.seconds >= 0
    assert record.peak_memory_mib > 1
    assert record.flags == ("a_flag",)


def test_records_of_an_earlier_program_are_read(workspace, stages):
    run(workspace)
    path = workspace.record_file("sfm")
    known = json.loads(path.read_text())
    failed = {"stage": "sfm", "status": "failed", "error": "too dark; film again", "exit_code": 4, "seconds": 2.5}
    path.write_text(json.dumps(failed))
    assert workspace.read_record("sfm") == Record("sfm", error="too dark; film again", exit_code=4, seconds=2.5)
    path.write_text(json.dumps(known | {"peak_memory_mib": None, "of_another_version": 1}))
    assert run(workspace).ran == []
