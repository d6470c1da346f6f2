"""Small stages in place of the real ones, for tests of what runs and why."""

from collections.abc import Callable
from pathlib import Path

import pytest

from cotton3dg.stages import cluster, frames, masks, scale, segment, sfm, train, traits
from cotton3dg.stages.stage import STAGES, Stage, stage_of
from cotton3dg.workspace import Workspace

MODULES = dict(zip(STAGES, (frames, sfm, train, masks, segment, cluster, scale, traits), strict=True))


def replace_stages(monkeypatch: pytest.MonkeyPatch, make: Callable[[str], Stage]) -> None:
    """Put `make(name)` in place of each stage, until the test ends."""
    for name, module in MODULES.items():
        assert stage_of(name) is module.STAGE
        monkeypatch.setattr(module, "STAGE", make(name))


def filmed_plant(folder: Path) -> Workspace:
    """A plant with a file that small stages take for its video."""
    plant = folder / "plant_007"
    plant.mkdir()
    (plant / "video.mp4").write_text("video")
    return Workspace(plant)
