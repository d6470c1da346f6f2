# SPDX-License-Identifier: Apache-2.0
"""Drop what a finished plant's folder does not need: images that its stages made, and remains of killed runs.

Results, records with their hashes and all files of the user stay. The stages stay up to date; before a stage runs
that reads dropped files, the pipeline makes these again.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ..io.saving import explain_disk_errors, file_sha256
from ..schemas.record import DroppedFiles
from ..stage import STAGES, stage_of
from ..workspace import Workspace

LEFT: Final = re.compile(r"\.(.+)\.(partial|old)")
"""The name of a file or folder while it is being replaced."""


@dataclass(frozen=True)
class Dropped:
    """The result: what the command freed."""

    n_files: int
    n_bytes: int
    finished: bool
    """Whether the images were dropped as well: an unfinished plant still needs them."""


def clean(workspace: Workspace) -> Dropped:
    """Free what can be made again.

    Raises:
        EnvironmentUnusable: another process works in the folder.
    """
    with workspace.locked(), explain_disk_errors(workspace.root):
        records = [workspace.read_record(stage) for stage in STAGES]
        finished = all(record and record.is_ok for record in records)
        images = _find_unchanged_images(workspace) if finished else []
        # Save the names first: if the process is killed in between, files that still exist count as present.
        if images:
            names = {path.relative_to(workspace.root).as_posix() for path in images}
            DroppedFiles(tuple(sorted(names | workspace.dropped().keys()))).save(workspace.dropped_json)
        files = images + _find_leftovers(workspace)
        n_bytes = sum(path.stat().st_size for path in files)
        for path in files:
            path.unlink()
        for folder in _find_partial_folders(workspace):
            shutil.rmtree(folder)
    return Dropped(len(files), n_bytes, finished)


def _find_unchanged_images(workspace: Workspace) -> list[Path]:
    """Files that stages can make again and that match their records; a file that somebody changed is the user's."""
    found = []
    for stage in STAGES:
        record = workspace.read_record(stage)
        recorded = record.outputs if record else {}
        found += [
            path
            for path in stage_of(stage).droppable(workspace)
            if recorded.get(path.relative_to(workspace.root).as_posix()) == file_sha256(path)
        ]
    return found


def _find_partial_folders(workspace: Workspace) -> list[Path]:
    """Folders of unfinished saves. In the plant's own folder only the names of this program count."""
    stages, films = _find_partials(workspace.root), _find_partials(workspace.render)
    ours = {*STAGES, "annotations", "check"}
    return [
        path
        for path, name in (*stages, *films)
        if path.is_dir() and (name.partition(".")[0] in ours or path.parent != workspace.root)
    ]


def _find_leftovers(workspace: Workspace) -> list[Path]:
    """Files of unfinished saves."""
    inside = [file for folder in _find_partial_folders(workspace) for file in folder.rglob("*") if file.is_file()]
    records = [path for path, _ in _find_partials(workspace.root / "records") if path.is_file()]
    pages = [
        path for path, name in _find_partials(workspace.root) if path.is_file() and name == workspace.report_html.name
    ]
    return inside + records + pages


def _find_partials(folder: Path) -> list[tuple[Path, str]]:
    """Paths with the name of an unfinished save, and the name that each would have got."""
    found = [(path, LEFT.fullmatch(path.name)) for path in folder.iterdir()] if folder.is_dir() else []
    return [(path, name[1]) for path, name in found if name]
