# SPDX-License-Identifier: Apache-2.0
"""A video with a black, a white, a corrupted and ten equal frames, in which the plant leaves the frame for a while."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scenes.room_scene import HEIGHT, WIDTH, render, textures

from cotton3dg import pipeline
from cotton3dg.io import video
from cotton3dg.workspace import Workspace

N, BLACK, WHITE, REPEATED, AWAY = 130, 17, 41, 60, range(90, 99)


def broken_video(path: Path) -> None:
    faces, frames = textures(), []
    for number in range(N):
        frame = render(faces, 2 * np.pi * number / N, yaw=0.9 if number in AWAY else 0.0)
        frames += {BLACK: [frame * 0], WHITE: [frame * 0 + 255], REPEATED: [frame] * 10}.get(number, [frame])
    command = [video.ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-r", "24"]
    command += ["-s", f"{WIDTH}x{HEIGHT}", "-i", "pipe:0", "-pix_fmt", "yuv420p", "-crf", "12", "-g", "8", "-bf", "0"]
    subprocess.run([*command, str(path)], input=b"".join(frame.tobytes() for frame in frames), check=True)
    content = bytearray(path.read_bytes())
    start = content.index(b"mdat") + len(content) * 85 // 100
    content[start : start + 60] = bytes(60)
    path.write_bytes(content)


@pytest.mark.slow
def test_a_broken_video_runs_through_and_every_defect_is_told(tmp_path: Path) -> None:
    broken_video(tmp_path / "walk.mp4")
    workspace = Workspace(tmp_path)
    options = pipeline.stage_options(
        workspace, overrides={"frames": {"count": 32}, "sfm": {"max_features": 1500, "overlap": 6}}
    )
    pipeline.run(workspace, options, ("frames", "sfm"))
    told, record = json.loads(workspace.frames_json.read_text()), workspace.read_record("frames")
    facts, taken = told["video"], [entry["source_index"] for entry in told["images"]]
    assert facts["n_decoded"] == N + 9
    assert N - 20 <= facts["n_intact"] < N + 9
    assert facts["blank"] == [BLACK, WHITE]
    assert set(facts["repeated"]) == set(range(REPEATED + 1, REPEATED + 10))
    assert not set(taken) & {BLACK, WHITE, *facts["repeated"]}
    assert {"video_damaged", "blank_frames", "repeated_frames"} <= set(record.flags)
    assert "2 of 139 frames are black, white or empty" in " ".join(record.warnings)
    assert "9 of 139 frames are repeats" in " ".join(record.warnings)

    told, record = json.loads(workspace.sfm_json.read_text()), workspace.read_record("sfm")
    away = {entry for entry in taken if entry - 9 in AWAY}
    assert 100 * len(told["registered"]) >= 90 * len(taken)
    assert away
    assert {taken[int(name[:6])] for name in told["plant_out_of_view"]} == away
    assert "plant_out_of_view" in record.flags
    assert f"in {len(away)} images" in " ".join(record.warnings)
