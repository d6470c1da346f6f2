# SPDX-License-Identifier: Apache-2.0
"""Which results are up to date, and why others are not. Content alone decides, never time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Final

from .core.runs import State
from .option_rules import as_dict
from .options import resolve
from .schemas.record import Record
from .stage import STAGES, stage_of
from .workspace import Workspace

UP_TO_DATE: Final = ""


@dataclass(frozen=True)
class StageState:
    """The state of one stage of a plant."""

    stage: str
    state: State
    reason: str
    """Why the stage is not done; empty if it is."""
    record: Record | None
    """The record of its last run."""

    @property
    def done(self) -> bool:
        return self.state == State.DONE


def state_of(stage: str, record: Record | None, reason: str) -> StageState:
    """The state of a stage that has to run for a reason; without one it does not."""
    if record and not record.is_ok:
        return StageState(stage, State.FAILED, record.error or f"{stage} failed; see run.log", record)
    if reason == UP_TO_DATE:
        return StageState(stage, State.DONE, reason, record)
    return StageState(stage, State.STALE if record else State.MISSING, reason, record)


def stale_reason(workspace: Workspace, stage: str, options: Any) -> str:
    """Why `stage` has to run, or '' if its saved result is the one that it would make again.

    Options, the stage's version, and the hashes of inputs and outputs decide. An option that the record does not name
    is younger than the record: its default gives the same result, or else the version would have been raised.
    """
    known, record = stage_of(stage), workspace.read_record(stage)
    if record is None:
        return "no finished result"
    if not record.is_ok:
        return "its last run failed"
    if record.stage_version != known.version:
        return f"version {record.stage_version} -> {known.version}"
    for name, (before, now) in changed_options(record, options).items():
        return f"option {name} {before} -> {now}"
    return _change("input", record.inputs, known.input_hashes(workspace, options)) or _change(
        "output", record.outputs, workspace.hashes(workspace.folder(stage))
    )


def changed_options(record: Record, options: Any) -> dict[str, tuple[Any, Any]]:
    """The options in effect that differ from those of a stage's run: name -> value then and now."""
    chosen = as_dict(options)
    method = next(iter(chosen))
    usual = as_dict(resolve(record.stage, {method: chosen[method]}))
    before = {name: record.options.get(name, usual[name]) for name in chosen}
    return {name: (before[name], now) for name, now in chosen.items() if before[name] != now}


def recorded_states(workspace: Workspace) -> tuple[StageState, ...]:
    """The state of every stage from the records alone, without reading large files, and with the options as they were.

    A stage that fails leaves the results of later stages as they were, made from other frames or options: a stage is
    done only when its record is ok, all stages before it are done, and it read what they wrote.
    """
    states: list[StageState] = []
    written: dict[str, str] = {}
    for stage in STAGES:
        record = workspace.read_record(stage)
        reason = next((f"after {item.stage}" for item in states if not item.done), UP_TO_DATE)
        if record is None:
            reason = "no finished result"
        else:
            read = {name: found for name, found in record.inputs.items() if _is_of_a_stage(name)}
            reason = reason or _change("input", read, {name: written[name] for name in read if name in written})
            written |= record.outputs
        states.append(state_of(stage, record, reason))
    return tuple(states)


def id_image(workspace: Workspace) -> Callable[[str], Path]:
    """The best id image of an undistorted image: of the bolls that are drawn into it, or, while these are not up to
    date, of its masks."""
    done = any(state.done for state in recorded_states(workspace) if state.stage == "cluster")
    return workspace.boll_ids_png if done else workspace.mask_png


def _is_of_a_stage(name: str) -> bool:
    """Whether an input is a file that a stage wrote; one with a # is part of a file (`Stage.parts`)."""
    return name.split("/", maxsplit=1)[0] in STAGES and "#" not in PurePath(name).suffix


def _change(kind: str, recorded: Mapping[str, str], found: Mapping[str, str]) -> str:
    """The difference between the first changed file and its record."""
    for name in sorted(recorded.keys() | found.keys()):
        if recorded.get(name) != found.get(name):
            change = "is missing" if name not in found else "is new" if name not in recorded else "changed"
            return f"{kind} {name} {change}"
    return UP_TO_DATE
