# SPDX-License-Identifier: Apache-2.0
"""The verdict of a first look at a film, and what is said of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes.documents import frame_info, frames_info
from scenes.walked_film import HEIGHT, WIDTH, camera_at, look_of, sight_of

from cotton3dg.capture_check.judge import conclude, judge, refuse
from cotton3dg.core.scene import Camera
from cotton3dg.report.verdicts import of_placed, of_sharpness, of_walk
from cotton3dg.scale.estimate_scale import no_scale
from cotton3dg.schemas.check import GREEN, RED, YELLOW, CheckInfo, Finding


def test_a_film_without_faults_is_green(cameras: list[Camera]) -> None:
    info = judge(look_of(cameras), 960, 12.34)
    assert info.verdict == GREEN
    assert info.line.startswith("360 degrees around the plant, 24 of 24 frames placed")
    assert "about 5 bolls" in info.line
    assert info.figures["bolls"] == 5
    assert info.seconds == 12.3


def test_a_table_of_assumed_size_is_named_and_no_fault_of_the_film(cameras: list[Camera]) -> None:
    look = look_of(cameras)
    info = replace(look.scale.info, table_cm=(120.0, 60.0), table_assumed=True)
    found = judge(replace(look, scale=replace(look.scale, info=info)), 960, 1.0)
    assert found.verdict == GREEN
    assert "scale to 0.2 %, table taken as 120 x 60 cm" in found.line


@pytest.mark.parametrize(("duration_s", "remarks"), [(8.5, 1), (40.0, 0), (math.nan, 0)])
def test_a_short_film_is_green_with_a_remark(cameras: list[Camera], duration_s: float, remarks: int) -> None:
    frames = frames_info([frame_info(camera.name) for camera in cameras])
    assert frames.video
    short = replace(frames, video=replace(frames.video, duration_s=duration_s))
    info = judge(replace(look_of(cameras), frames=short), 960, 1.0)
    assert info.verdict == GREEN and info.line.count("s long; 20 to 60 s") == remarks


def test_the_report_judges_as_the_check_does(cameras: list[Camera]) -> None:
    """A fifth of the frames blurred and a gap of 45 degrees: usable, and called so on both pages."""
    images = tuple(frame_info(camera.name, blur=0.6 if i % 5 == 0 else 0.2) for i, camera in enumerate(cameras))
    look = look_of(cameras[:-2])
    checked = judge(replace(look, frames=frames_info(list(images))), 960, 1.0)
    reported = [
        of_walk(look.orbit.coverage_deg, look.orbit.largest_gap_deg),
        of_placed(len(look.cameras), len(look.names)),
        of_sharpness(images, 0.0, [15.0]),
    ]
    assert {finding.verdict for finding in reported} == {GREEN}
    assert {str(finding) for finding in reported} <= {str(finding) for finding in checked.findings}


@pytest.mark.parametrize(
    ("change", "verdict", "said"),
    [
        ({"names": tuple(f"{i}.jpg" for i in range(40))}, YELLOW, "24 of 40 frames placed; walk more slowly"),
        (
            {"scale": no_scale("none", "no scale was found; film the table")},
            YELLOW,
            "no scale was found at a first look; film the",
        ),
        ({"bolls": []}, YELLOW, "no boll was found"),
    ],
)
def test_what_run_would_flag_is_yellow(cameras: list[Camera], change: dict, verdict: str, said: str) -> None:
    info = judge(look_of(cameras, **change), 960, 1.0)
    assert info.verdict == verdict
    assert said in info.line


def test_half_a_turn_says_which_part_is_missing() -> None:
    info = judge(look_of([camera_at(a) for a in range(0, 200, 10)]), 960, 1.0)
    assert info.verdict == YELLOW
    assert "you stopped 170 degrees before the turn was full" in info.line


def test_light_that_burns_the_lint_or_leaves_a_dark_side_is_yellow(cameras: list[Camera]) -> None:
    look = look_of(cameras)
    burnt = [replace(sight, burnt_share=0.5) for sight in look.sights]
    uneven = [replace(sight, lint_luminance=0.9 if i < 6 else 0.2) for i, sight in enumerate(look.sights)]
    assert "50% of the lint is burnt out white; lower the exposure" in judge(replace(look, sights=burnt), 960, 1.0).line
    assert "4.5 times brighter on one side" in judge(replace(look, sights=uneven), 960, 1.0).line


def test_small_bolls_are_told_by_their_width_in_the_training_images(cameras: list[Camera]) -> None:
    assert judge(look_of(cameras), 960, 1.0).figures["boll_px"] == pytest.approx(15.1, abs=0.5)
    assert "film closer" in judge(look_of(cameras), 320, 1.0).line


def test_a_plant_cut_nearly_everywhere_is_red(cameras: list[Camera]) -> None:
    stem = np.zeros((HEIGHT // 2, WIDTH // 2), np.int32)
    stem[:, WIDTH // 4 - 40 : WIDTH // 4 + 40] = 1
    look = look_of(cameras)
    info = judge(replace(look, sights=[sight_of(camera, plant=stem) for camera in cameras]), 960, 1.0)
    assert info.verdict == RED
    assert "cut by the top of the frame" in info.line
    assert "step back" in info.line


def test_motion_that_blurs_bolls_is_yellow_and_a_little_is_not(cameras: list[Camera]) -> None:
    look = look_of(cameras)
    width_px = float(np.median(np.concatenate([sight.diameters_px for sight in look.sights])))
    assert judge(replace(look, blur_px=0.2 * width_px), WIDTH, 1.0).verdict == GREEN
    info = judge(replace(look, blur_px=0.3 * width_px), WIDTH, 1.0)
    assert info.verdict == YELLOW
    assert "much of a boll's width; walk more slowly" in info.line
    assert info.figures["motion_blur_px"] == 0.3 * width_px


def test_the_worst_comes_first_and_the_others_are_counted(tmp_path: Path) -> None:
    found = [Finding(GREEN, "a", "good"), Finding(YELLOW, "b", "dark", "lamp"), Finding(RED, "c", "cut", "step back")]
    info = conclude(found, {"placed": 3}, 1.0)
    assert (info.verdict, info.line) == (RED, "cut; step back (and 1 more)")
    info.save(tmp_path / "check.json")
    assert CheckInfo.load(tmp_path / "check.json") == info


def test_a_refused_film_is_red_in_the_words_of_the_stage() -> None:
    info = refuse("walk.mp4 is too short: 1 s; film one slow full turn", 2.0)
    assert (info.verdict, info.line) == (RED, "walk.mp4 is too short: 1 s; film one slow full turn")
    assert info.findings[0].remedy == "film one slow full turn"
