# SPDX-License-Identifier: Apache-2.0
"""Small stages in place of the real ones, for tests of what runs and why."""

from collections.abc import Callable
from pathlib import Path

import pytest

from cotton3dg.cluster import stage as cluster
from cotton3dg.core.runs import StageOutcome
from cotton3dg.frames import stage as frames
from cotton3dg.masks import stage as masks
from cotton3dg.scale import stage as scale
from cotton3dg.segment import stage as segment
from cotton3dg.sfm import stage as sfm
from cotton3dg.stage import STAGES, Cost, Stage, stage_of
from cotton3dg.train import stage as train
from cotton3dg.traits import stage as traits
from cotton3dg.workspace import Workspace

MODULES = dict(zip(STAGES, (frames, sfm, train, scale, masks, segment, cluster, traits), strict=True))


def replace_stages(monkeypatch: pytest.MonkeyPatch, make: Callable[[str], Stage]) -> None:
    """Put `make(name)` in place of each stage, until the test ends."""
    for name, module in MODULES.items():
        assert stage_of(name) is module.STAGE
        monkeypatch.setattr(module, "STAGE", make(name))


def copying_stage(name: str) -> Stage:
    """One that copies the text of the stage before, adding its name; `scale` always writes the same."""
    position = STAGES.index(name)

    def source(workspace: Workspace) -> Path:
        return workspace.capture() if not position else workspace.folder(STAGES[position - 1]) / "out.txt"

    def run(workspace: Workspace, options: object, progress: object) -> StageOutcome:
        with workspace.writing(name) as folder:
            text = source(workspace).read_text()
            (folder / "out.txt").write_text(f"{text} {name}" if name != "scale" else "constant")
            if name == "traits":
                (folder / workspace.traits_csv.name).write_text(f"plant_id\n{workspace.plant_id}\n")
        return StageOutcome({"letters": len(text)}, ("a_flag",), ("be careful; do this",))

    return Stage(name, 1, lambda workspace: [source(workspace)], run, lambda work: Cost(0.0))


def filmed_plant(folder: Path) -> Workspace:
    """A plant with a file that small stages take for its video."""
    plant = folder / "plant_007"
    plant.mkdir()
    (plant / "video.mp4").write_text("video")
    return Workspace(plant)
