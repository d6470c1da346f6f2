# SPDX-License-Identifier: Apache-2.0
"""report.html of plants that failed, are damaged or mean harm."""

import json
import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scenes.finished_scene import record
from scenes.report_page import HOSTILE, Page, fail

from cotton3dg import pipeline
from cotton3dg.cluster import stage as cluster
from cotton3dg.errors import CaptureFailed
from cotton3dg.options import resolve
from cotton3dg.report.facts import read_facts
from cotton3dg.report.page import is_stale, plant_page
from cotton3dg.segment import stage as segment
from cotton3dg.traits import stage as traits
from cotton3dg.workspace import Workspace


def test_a_hostile_name_and_hostile_metadata_are_only_text(reported, tmp_path):
    name = HOSTILE.replace("/", "∕")
    shutil.copytree(reported.root, tmp_path / name)
    workspace = Workspace(tmp_path / name)
    facts = json.loads(workspace.frames_json.read_text())
    facts["file"] = HOSTILE
    facts["images"][1]["name"] = "../../" + HOSTILE
    workspace.frames_json.write_text(json.dumps(facts))
    harmless = workspace.traits_csv.read_text().replace("orbit_gap", "<b>flag</b>")
    workspace.traits_csv.write_text(harmless)
    entry = workspace.read_record("scale")
    workspace.write_record(replace(entry, flags=(HOSTILE,), warnings=(HOSTILE,), summary={HOSTILE: HOSTILE}))
    text = plant_page(workspace, failure=HOSTILE)
    seen = Page(text)
    assert HOSTILE in seen.text
    assert seen.count("img", src="x") == 0
    assert seen.count("b") == 4  # the cards' figures
    assert "49" not in re.findall(r"\{\{.*?\}\}|>49<", text)
    assert seen.count("script") == 9  # the page's seven, the data of scene and photos


def test_failures_are_explained_with_what_there_is(reported_copy):
    fail(reported_copy, "sfm", "7 of 17 frames registered (40 % needed); film one slow full turn")
    seen = Page(plant_page(reported_copy))
    assert "No result" in seen.text
    assert "7 of 17 frames registered (40 % needed)" in seen.text
    assert "What to do: film one slow full turn" in seen.text
    assert "Every boll that was found" not in seen.text  # bolls of an earlier video
    assert seen.count("img") == 11  # the strip of frames, and the empty one that enlarges
    assert "out of date" in seen.text


def test_a_required_scale_that_is_missing_leaves_the_pictures(reported_copy):
    fail(
        reported_copy, "scale", "no scale was found (table: one edge is unclear); lay printed markers beside the plant"
    )
    seen = Page(plant_page(reported_copy))
    assert "No result" in seen.text
    assert "What to do: lay printed markers beside the plant" in seen.text
    for heading in ("Photo against model", "The walk"):
        assert heading in seen.text
    assert "Every boll that was found" not in seen.text  # bolls of an earlier scale
    assert "Plant height" not in seen.text


def test_results_of_other_inputs_are_not_shown(reported_copy):
    entry = reported_copy.read_record("train")
    reported_copy.write_record(replace(entry, outputs=entry.outputs | {"train/gaussians.ply": "another"}))
    facts = read_facts(reported_copy)
    assert [item.state for item in facts.stages] == ["done"] * 3 + ["stale"] * 5
    assert not facts.traits
    assert "scale" in facts.failure


def test_without_scale_and_without_bolls_the_page_says_so(reported_copy):
    with reported_copy.writing("scale") as made:
        (made / "scale.json").write_text(json.dumps({"source": "none", "reason": "no table"}))
    record(reported_copy, "scale", ("no_scale",))
    traits.run(reported_copy, resolve("traits"))
    record(reported_copy, "traits")
    seen = Page(plant_page(reported_copy))
    assert "Counted only" in seen.text
    assert "No scale: no table" in seen.text
    assert '"unit": "scene units"' in plant_page(reported_copy)
    for path in reported_copy.folder("masks").glob("*.png"):
        cv2.imwrite(str(path), np.zeros((240, 320), np.uint16))
    record(reported_copy, "masks", ("no_masks",))
    for module in (segment, cluster, traits):
        stage = module.STAGE.name
        outcome = module.run(reported_copy, resolve(stage))
        record(reported_copy, stage, outcome.flags)
        if stage == "cluster":
            record(reported_copy, "scale", ("no_scale",))
    seen = Page(plant_page(reported_copy))
    assert "No bolls were found" in seen.text
    assert "What to do: Look at the photos" in seen.text
    assert seen.count("table") == 1  # no table of bolls


def test_a_folder_without_anything_has_a_page(tmp_path):
    seen = Page(plant_page(Workspace(tmp_path)))
    assert "no video" in seen.text
    assert "What to do: copy the plant's video here" in seen.text


@pytest.mark.parametrize(
    "file",
    [
        "train/gaussians.ply",
        "cluster/bolls.json",
        "segment/selections.npz",
        "masks/000003.png",
        "traits/bolls.csv",
        "sfm/sfm.json",
    ],
)
def test_a_damaged_file_costs_its_parts_only(reported_copy, file):
    (reported_copy.root / file).write_bytes(b"damaged")
    seen = Page(plant_page(reported_copy))
    assert "Plant height" in seen.text
    assert "Every boll that was found" in seen.text
    assert "The walk around the plant" in seen.text


def test_a_failed_run_leaves_a_page_that_says_why(tmp_path):
    folder = tmp_path / "plant_018"
    folder.mkdir()
    (folder / "video.mp4").write_text("no video")
    workspace = Workspace(folder)
    with pytest.raises(CaptureFailed):
        pipeline.run(workspace, pipeline.stage_options(workspace), report=True)
    assert "copy it again from the phone" in workspace.report_html.read_text()
    assert is_stale(workspace, "no video")
