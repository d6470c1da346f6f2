# SPDX-License-Identifier: Apache-2.0
"""Whether a film will do while the plant still stands: placed frames, views, sharpness, light, table, first count.

It runs the stages before the training, or the first half of them, and `run` goes on from there. If a run has made
results, it works in a temporary folder and leaves them as they are.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..capture_check.judge import judge, refuse
from ..capture_check.page import check_page, strip_of
from ..capture_check.preview import Look, preview_capture
from ..errors import CaptureFailed
from ..io.colmap import read_cameras
from ..io.saving import explain_disk_errors
from ..pipeline import Watcher, begin, run
from ..schemas.check import CheckInfo, film_of
from ..schemas.frames import FramesInfo
from ..schemas.record import Choices
from ..sfm.keyframes import Keyframes, has_enough_images
from ..sfm.lens import undistort
from ..sfm.registration_quality import decide_distortion, describe_cameras
from ..stage import STAGES
from ..staleness import stale_reason
from ..workspace import Workspace


def check(workspace: Workspace, options: dict[str, Any], watcher: Watcher, choices: Choices | None = None) -> CheckInfo:
    """Look at a plant's film; saves check/check.json and check/check.html.

    The check uses the results of a run if they were made with the same options, and never changes them.

    Args:
        options: of every stage, as `run` would take them.
        choices: those with which `run` begins when it goes on from the check.
    Returns:
        The verdict; a film that a stage refuses is red.
    Raises:
        Cotton3dgError: the fault is not the film's.
    """
    start = time.perf_counter()
    look, frames, plant_id = None, None, options["traits"].plant_id or workspace.plant_id
    with _where_to_work(workspace, options) as place:
        try:
            run(place, options, ("frames",), watcher=watcher, choices=choices)
            frames = FramesInfo.load(place.frames_json)
            with _passing_folder(place) as scratch:
                names, undistorted = _place(place, options, watcher, scratch, choices)
                side_px = options["train"].max_side
                look = preview_capture(place, names, undistorted, options["scale"], side_px, watcher.watched("check"))
                info = judge(look, side_px, time.perf_counter() - start)
                return _save(workspace, plant_id, info, look, frames, place)
        except CaptureFailed as error:
            return _save(workspace, plant_id, refuse(str(error), time.perf_counter() - start), None, frames, place)


@contextmanager
def _where_to_work(workspace: Workspace, options: dict[str, Any]) -> Iterator[Workspace]:
    """The plant's folder, from which `run` goes on; if it has results, a temporary one with the usable ones."""
    records = map(workspace.read_record, STAGES[1:])
    if not any(record and record.is_ok for record in records):
        yield workspace
        return
    with workspace.locked(), _passing_folder(workspace) as folder:
        passing = Workspace(folder)
        workspace.share_inputs(passing)
        for stage in ("frames", "sfm"):
            if stale_reason(workspace, stage, options[stage]):
                break
            workspace.share_result(stage, passing)
        yield passing


@contextmanager
def _passing_folder(workspace: Workspace) -> Iterator[Path]:
    """A temporary folder, removed at the end; `clean` drops the one of a killed check."""
    with explain_disk_errors(workspace.root):
        folder = tempfile.TemporaryDirectory(dir=workspace.root, prefix=".check.", suffix=".partial")
    with folder as name:
        yield Path(name)


def _place(
    workspace: Workspace, options: dict[str, Any], watcher: Watcher, scratch: Path, choices: Choices | None
) -> tuple[tuple[str, ...], Path]:
    """Names of the images to place, and the folder of the placed ones, without lens distortion.

    It places the keyframes of a film if these are enough, else all images, as `run` does.
    """
    names = tuple(path.name for path in workspace.frame_images())
    if stale_reason(workspace, "sfm", options["sfm"]):
        begin(workspace, "sfm", options["sfm"], watcher)
        if workspace.sfm_begun.is_dir():
            keyframes = Keyframes.load(workspace.sfm_begun)
            model = keyframes.read_model()
            if has_enough_images(model, len(keyframes.images)):
                chosen = tuple(names[i] for i in keyframes.images)
                return chosen, _undistort(workspace, model, chosen, options["sfm"].distortion, scratch)
        run(workspace, options, ("sfm",), watcher=watcher, choices=choices)
    return names, workspace.undistorted


def _undistort(workspace: Workspace, model: Any, names: tuple[str, ...], distortion: str, scratch: Path) -> Path:
    """The folder of the model's images without lens distortion.

    Raises:
        CaptureFailed: its cameras saw the plant from one side only.
    """
    straight, lens = decide_distortion(model, distortion)
    (scratch / "model").mkdir()
    straight.write_binary(scratch / "model")
    undistort(workspace.folder("frames"), scratch / "model", scratch / "undistorted")
    describe_cameras([straight], names, read_cameras(scratch / "undistorted" / "sparse"), lens)
    return scratch / "undistorted"


def _save(
    workspace: Workspace,
    plant_id: str,
    info: CheckInfo,
    look: Look | None,
    frames: FramesInfo | None,
    place: Workspace,
) -> CheckInfo:
    """Save the findings together with the film that they belong to, and return them.

    Args:
        plant_id: as the page names the plant. place: where the frames are.
    """
    info = replace(info, film=film_of(place.read_record("frames")))
    strip = strip_of(frames, place.folder("frames")) if frames and look is None else []
    with workspace.writing("check") as folder:
        info.save(folder / workspace.check_json.name)
        page = check_page(plant_id, info, look, frames, strip)
        (folder / workspace.check_html.name).write_text(page, encoding="utf-8")
    return info
