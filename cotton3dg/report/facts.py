# SPDX-License-Identifier: Apache-2.0
"""The facts in the files of a plant's folder, as far as the files still belong to its video."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ..core.runs import State
from ..errors import BadInput, Cotton3dgError
from ..io.tables import read_rows
from ..option_rules import as_dict
from ..options import PRESET_VALUES, PRESETS, resolve
from ..schemas.corrections import Corrections
from ..schemas.document import Document
from ..schemas.frames import FramesInfo
from ..schemas.scale import ScaleInfo
from ..schemas.sfm import SfmInfo
from ..schemas.skeleton import SkeletonInfo
from ..schemas.train import Effects, TrainMetrics
from ..staleness import StageState, recorded_states
from ..workspace import Workspace

T = TypeVar("T", bound=Document)


@dataclass(frozen=True)
class Facts:
    """Everything that a page says about a plant besides pictures."""

    plant_id: str
    stages: tuple[StageState, ...]
    failure: str
    """Why there is no result, as `what is wrong; what to do`; empty when all stages are done."""
    preset: str
    """The preset of the last run; `standard` too where other options were chosen."""
    traits: dict[str, str]
    """The plant's row of traits.csv; empty when there is none."""
    bolls: list[dict[str, str]]
    """Rows of bolls.csv."""
    columns: dict[str, str]
    """The meaning of each column, by its name."""
    frames: FramesInfo | None
    sfm: SfmInfo | None
    metrics: TrainMetrics | None
    effects: Effects | None
    scale: ScaleInfo | None
    skeleton: SkeletonInfo | None
    corrections: Corrections | None
    """Corrections that a person made."""

    def done(self, stage: str) -> bool:
        return any(item.stage == stage and item.done for item in self.stages)

    def warnings(self, stage: str) -> tuple[str, ...]:
        """Warnings of the stage's last run, if it is done."""
        records = [item.record for item in self.stages if item.stage == stage and item.done and item.record]
        return tuple(records[0].warnings) if records else ()

    @property
    def flags(self) -> list[str]:
        """Quality flags of all stages that are done, each once."""
        records = [item.record for item in self.stages if item.done and item.record]
        return list(dict.fromkeys(flag for record in records for flag in record.flags))


def read_facts(workspace: Workspace) -> Facts:
    """Gather all facts; whatever is missing or damaged is None or empty."""
    stages = recorded_states(workspace)
    done = {item.stage for item in stages if item.done}

    def when_done(stage: str, kind: type[T], path: Path) -> T | None:
        try:
            return kind.load(path) if stage in done else None
        except BadInput:
            return None

    traits = _read_rows(workspace.traits_csv) if "traits" in done else []
    plant_id = traits[0].get("plant_id", "") if traits else ""
    return Facts(
        plant_id=plant_id or workspace.plant_id,
        stages=stages,
        failure=_failure(workspace, stages),
        preset=preset_of({item.stage: item.record.options for item in stages if item.record}),
        traits=traits[0] if traits else {},
        bolls=_read_rows(workspace.bolls_csv) if "traits" in done else [],
        columns={row.get("column", ""): row.get("description", "") for row in _read_rows(workspace.columns_csv)},
        frames=when_done("frames", FramesInfo, workspace.frames_json),
        sfm=when_done("sfm", SfmInfo, workspace.sfm_json),
        metrics=when_done("train", TrainMetrics, workspace.metrics_json),
        effects=when_done("train", Effects, workspace.effects_json),
        scale=when_done("scale", ScaleInfo, workspace.scale_json),
        skeleton=when_done("traits", SkeletonInfo, workspace.skeleton_json),
        corrections=when_done("traits", Corrections, workspace.corrections_json),
    )


def preset_of(made: Mapping[str, Mapping[str, Any]]) -> str:
    """The preset with all of its values in the recorded options of stages; of several, the one that sets most."""

    def sets(preset: str) -> list[tuple[str, str, Any]]:
        return [
            (stage, name, value)
            for stage, values in PRESET_VALUES[preset].items()
            for name, value in as_dict(resolve(stage, values)).items() - as_dict(resolve(stage)).items()
        ]

    def holds(preset: str) -> bool:
        return all(made.get(stage, {}).get(name) == value for stage, name, value in sets(preset))

    return max(filter(holds, PRESETS), key=lambda preset: len(sets(preset)))


def _failure(workspace: Workspace, stages: tuple[StageState, ...]) -> str:
    for item in stages:
        if item.state == State.FAILED:
            return item.reason
        if not item.done:
            try:
                workspace.capture()
            except Cotton3dgError as error:
                return str(error)
            why = "has not run yet" if item.state == State.MISSING else "ran before something it depends on changed"
            return f"the stage {item.stage} {why}; run `cotton3dg run` on this plant"
    return ""


def _read_rows(path: Path) -> list[dict[str, str]]:
    try:
        return read_rows(path)
    except BadInput:
        return []
