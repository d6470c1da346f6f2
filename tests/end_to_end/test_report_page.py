# SPDX-License-Identifier: Apache-2.0
"""report.html of a plant: what it tells, its size, its closedness, when it is made."""

import base64
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes.documents import effects
from scenes.finished_scene import UNPLACED
from scenes.report_page import Page

from cotton3dg import pipeline
from cotton3dg.errors import BadInput
from cotton3dg.options import STAGE_OPTIONS
from cotton3dg.report import page as report_page
from cotton3dg.report.advice import FLAGS, advise_on_capture, meaning
from cotton3dg.report.facts import read_facts
from cotton3dg.report.page import is_stale, make_report
from cotton3dg.schemas.check import GREEN, VERDICTS, YELLOW
from cotton3dg.schemas.sfm import LensDecision
from cotton3dg.schemas.train import ExposureDecision, MotionBlurFound, RollingShutterFound


def test_the_page_tells_traits_flags_bolls_walk_and_stages(reported):
    text = reported.report_html.read_text(encoding="utf-8")
    seen = Page(text)
    traits = read_facts(reported).traits
    assert "plant_017" in seen.text
    assert f"{float(traits['plant_height_cm']):.1f} cm" in seen.text
    assert "±" in seen.text
    for flag in ("few_frames_registered", "orbit_gap"):
        assert FLAGS[flag].title in seen.text
        assert FLAGS[flag].action in seen.text
    assert [found["data-boll"] for name, found in seen.tags if "data-boll" in found] == ["1", "2", "3", "4"]
    assert seen.count("input", type="range") == 3
    assert "16 of 17 frames placed" in seen.text
    assert "330 degrees around the plant" in seen.text
    assert f"{UNPLACED} at 8.0 s" in text
    for stage in STAGE_OPTIONS:
        assert stage in seen.text
    assert seen.text.count("321") == len(STAGE_OPTIONS)
    scene = json.loads(re.search(r'id="scene_data">(.*?)</script>', text, re.S)[1])
    assert [boll["id"] for boll in scene["bolls"]] == [1, 2, 3, 4]
    centres = {row["boll_id"]: [float(row[f"{axis}_cm"]) for axis in "xyz"] for row in read_facts(reported).bolls}
    for boll in scene["bolls"]:
        assert boll["centre"] == pytest.approx(centres[str(boll["id"])], abs=0.3)


def test_bodies_in_3d_have_the_measured_volumes(reported):
    from scipy.spatial import ConvexHull

    text = reported.report_html.read_text(encoding="utf-8")
    scene = json.loads(re.search(r'id="scene_data">(.*?)</script>', text, re.S)[1])
    volumes = {row["boll_id"]: float(row["volume_cm3"]) for row in read_facts(reported).bolls}
    for boll in scene["bolls"]:
        axes = [np.frombuffer(base64.b64decode(axis), np.float32) for axis in boll["corners"]]
        assert ConvexHull(np.stack(axes, 1)).volume == pytest.approx(volumes[str(boll["id"])], rel=1e-3)


def test_the_page_is_small_closed_and_accessible(reported):
    assert reported.report_html.stat().st_size < 4e6
    text = reported.report_html.read_text(encoding="utf-8")
    seen = Page(text)
    (policy,) = [found["content"] for name, found in seen.tags if "http-equiv" in found]
    assert policy.startswith("default-src 'none'; img-src data: blob:;")
    assert "unsafe" not in policy.partition("script-src")[2]
    for tag, found in seen.tags:
        for key in ("src", "href"):
            assert (found.get(key) or "data:").startswith(("data:", "#")), (tag, found)
        assert not [key for key in found if key.startswith("on")]
    assert all("alt" in found for tag, found in seen.tags if tag == "img")
    assert seen.count("html", lang="en") == seen.count("h1") == seen.count("main") == 1
    assert all("aria-label" in found for tag, found in seen.tags if tag in ("input", "svg"))


def test_every_flag_of_the_stages_has_words():
    source = "".join(path.read_text() for path in Path(pipeline.__file__).parent.rglob("*.py"))
    appended = set(re.findall(r'(?<!doubts )flags(?:\.append\(| \+= \()"([a-z_]+)"', source))
    assert len(appended) > 10
    assert appended <= FLAGS.keys(), appended - FLAGS.keys()
    assert meaning("new_flag").title == "new flag"


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (ExposureDecision("auto", False, 0.22, 0.15, 1.0), "steady: 0.2 % (± 0.1"),
        (ExposureDecision("auto", True, 7.8, 0.2, 1.0), "drifted by 7.8 % (± 0.2"),
        (ExposureDecision("auto", False, 0.0, None, 1.0), "steady"),
    ],
)
def test_the_evidence_for_effects_is_shown(reported, found, text):
    facts = replace(read_facts(reported), effects=effects(exposure=found))
    (item,) = [item for item in advise_on_capture(facts) if item.topic == "Exposure"]
    assert item.verdict == GREEN  # what was corrected, or is no fault
    assert text in item.text


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (
            LensDecision("auto", False, -0.001, 0.1, 0.4),
            "straight: a distortion explains 0.00 %",
        ),
        (
            LensDecision("auto", True, 1.9, 0.1, 15.2),
            "by 15.2 px in the corners; corrected",
        ),
    ],
)
def test_what_was_found_about_the_lens_is_shown(reported, found, text):
    facts = replace(read_facts(reported), effects=effects(distortion=found))
    (item,) = [item for item in advise_on_capture(facts) if item.topic == "Lens"]
    assert item.verdict == GREEN
    assert text in item.text


BLUR = MotionBlurFound(
    on=False, found=False, median_px=0.8, strong_px=1.4, error_px=0.1, visible_from_px=2.0, flow_px=3.0, lengths_px={}
)
SHUTTER = RollingShutterFound(
    on=False, found=False, read_out_frames=0.0, error_frames=0.01, shift_px=0.04, left_px=0.01, visible_from_px=0.5
)


@pytest.mark.parametrize(
    ("effect", "found", "text"),
    [
        ("motion_blur", BLUR, "middle image by 0.8 px and nine of ten by less than 1.4 px, where 2 px"),
        (
            "motion_blur",
            replace(BLUR, found=True, median_px=5.0),
            "; walking more slowly, or more light, helps",
        ),
        ("rolling_shutter", SHUTTER, "none to be seen: 0.04 px"),
        (
            "rolling_shutter",
            replace(SHUTTER, found=True, shift_px=1.2, left_px=0.1),
            "by 1.2 px; the cameras' positions take up all but 0.10 px",
        ),
        ("rolling_shutter", replace(SHUTTER, found=True, shift_px=9.0, left_px=0.7), "evenly"),
    ],
)
def test_what_motion_did_to_the_images_is_shown(reported, effect, found, text):
    facts = replace(read_facts(reported), effects=effects(**{effect: found}))
    (item,) = [item for item in advise_on_capture(facts) if item.topic == effect.replace("_", " ").capitalize()]
    assert item.verdict == GREEN
    assert text in item.text


def test_motion_that_could_not_be_judged_is_not_told(reported):
    blur, shutter = replace(BLUR, median_px=math.nan), replace(SHUTTER, error_frames=math.nan)
    facts = replace(read_facts(reported), effects=effects(motion_blur=blur, rolling_shutter=shutter))
    assert {"Motion blur", "Rolling shutter"}.isdisjoint(item.topic for item in advise_on_capture(facts))


def test_a_forced_effect_needs_no_evidence(reported):
    facts = replace(read_facts(reported), effects=effects(distortion=LensDecision("on", on=True)))
    assert {"Exposure", "Lens"}.isdisjoint(item.topic for item in advise_on_capture(facts))


def test_advice_names_what_this_video_lacks(reported):
    facts = read_facts(reported)
    advice = {item.topic: item for item in advise_on_capture(facts, [8.0, 9.0, 40.0])}
    assert advice["Bolls"].verdict == YELLOW
    assert "9 px wide" in advice["Bolls"].text
    # What `run` does not flag is no doubt: a gap of 45 degrees, one frame without a camera, few blurred ones.
    assert {advice[topic].verdict for topic in ("Walk", "Placed frames", "Sharpness", "Light", "Scale")} == {GREEN}
    assert "the others from 7 to 8 s" in advice["Sharpness"].text
    states = [item.verdict for item in advise_on_capture(facts, [8.0])]
    assert states == sorted(states, key=VERDICTS.index, reverse=True)


def test_run_makes_the_page_once_and_never_fails_by_it(reported_copy, monkeypatch):
    class Ears(pipeline.Watcher):
        def __init__(self):
            self.heard = []

        def reported(self, remark):
            self.heard.append(remark)

    def run(**keywords):
        ears = Ears()
        pipeline.run(reported_copy, pipeline.stage_options(reported_copy), ("cluster",), watcher=ears, **keywords)
        return ears.heard

    assert is_stale(reported_copy) is False
    assert run() == run(report=True) == []
    with reported_copy.report_html.open("a") as file:
        file.write("changed by hand")
    (remark,) = run(report=True)
    assert remark == f"see {reported_copy.report_html}"
    assert run(report=True) == []
    reported_copy.report_html.unlink()
    monkeypatch.setattr(report_page, "plant_page", lambda *_: 1 / 0)
    (remark,) = run(report=True)
    assert "warning: could not be made (division by zero)" in remark


def test_a_page_of_somebody_else_is_never_replaced(reported_copy):
    reported_copy.report_html.write_text("mine")
    with pytest.raises(BadInput, match="was not made by it"):
        make_report(reported_copy)
    assert reported_copy.report_html.read_text() == "mine"
