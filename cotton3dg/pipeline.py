# SPDX-License-Identifier: Apache-2.0
"""Stages in order: which are stale and why, and runs of them with a record each."""

from __future__ import annotations

import logging
import os
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from .choices import Asked, choices_of, choose, plant_and_options
from .core.runs import Progress, silent
from .core.usage import cpu_seconds, peak_memory_mib, reset_peak_memory
from .errors import BadInput, BadUsage, Cotton3dgError, EnvironmentUnusable, OutOfResources, StageFailed, unknown
from .recorded_options import recorded
from .resource_checks import check_disk, check_memory, is_out_of_memory
from .schemas.record import Choices, Record
from .stage import STAGES, stage_of
from .staleness import StageState, stale_reason, state_of
from .workspace import Workspace

log = logging.getLogger("cotton3dg")

NOT_OF_THE_PLANT: Final = (BadUsage, EnvironmentUnusable)
"""Failures because of the command, a file from the user, or this machine. Earlier results stay valid."""


@dataclass(frozen=True)
class Step:
    """One stage as `run` finds it."""

    stage: str
    options: Any
    reason: str
    """Why the stage has to run; empty if its result is up to date."""


class Watcher:
    """Receives the messages of `run` while it works. The command line shows them; this class is silent."""

    def watched(self, name: str, reason: str = "") -> Progress:
        """The progress of work that is not a stage."""
        return silent

    def begins(self, workspace: Workspace, options: dict[str, Any], stages: tuple[str, ...], force: bool) -> None:
        """A run of `stages` begins; `plan` says which of them have to run."""

    def started(self, step: Step) -> Progress:
        """A stage starts; returns the progress to hand to it."""
        return silent

    def finished(self, step: Step, record: Record) -> None:
        """A stage ended and its record is saved."""

    def skipped(self, step: Step) -> None:
        """A stage's result is up to date."""

    def reported(self, remark: str) -> None:
        """The plant's page was made, or could not be made."""


def stage_options(
    workspace: Workspace | None,
    preset: str | None = None,
    overrides: dict[str, dict[str, Any]] | None = None,
    chosen: dict[str, dict[str, Any]] | None = None,
) -> dict[str, Any]:
    """Options of every stage, as the command `run` takes them (`choices.py`).

    Args:
        preset: preset to begin with; by default that of the plant's last run.
        overrides: values as the command line gives them with --set.
        chosen: choice of a program that begins anew; the plant's files win over it.
    """
    return choose(workspace, Asked(preset, values=overrides or {}, budgeted=chosen or {})).options


def selected(first: str = STAGES[0], last: str = STAGES[-1]) -> tuple[str, ...]:
    """The stages from `first` to `last`.

    Raises:
        BadUsage: a stage is unknown, or no stage lies between the two.
    """
    for name in (first, last):
        if name not in STAGES:
            raise unknown(f"stage {name!r}", name, STAGES)
    stages = STAGES[STAGES.index(first) : STAGES.index(last) + 1]
    if not stages:
        raise BadUsage(f"no stage lies from {first} until {last}; the order is {', '.join(STAGES)}")
    return stages


def _reason_to_run(workspace: Workspace, stage: str, options: Any, stages: tuple[str, ...], force: bool) -> str:
    if force:
        return "forced"
    reason = stale_reason(workspace, stage, options)
    # A whole run does not need the files that `clean` dropped; a user who names a stage wants its files.
    if not reason and stages != STAGES and workspace.dropped(workspace.folder(stage)):
        reason = "clean dropped its files"
    return reason


def _remade_for(workspace: Workspace, stage: str) -> list[Step]:
    """The stages that have to make their files again because `clean` dropped them and `stage` reads them."""
    steps: list[Step] = []
    makers = {name.split("/")[0] for name in workspace.dropped(*stage_of(stage).inputs(workspace))}
    for maker in (name for name in STAGES if name in makers):
        record = workspace.read_record(maker)
        steps += _remade_for(workspace, maker)
        options = recorded(maker, record.options, record.stage_version) if record else recorded(maker, {})
        steps.append(Step(maker, options, f"{stage} reads what clean dropped"))
    return steps


def _runs_after(maker: str, workspace: Workspace, stage: str, options: Any) -> bool:
    """Whether a stage has to run because `maker` does; a stage without a result runs after any."""
    return workspace.read_record(stage) is None or stage_of(stage).follows(workspace, options, [maker])


def plan(workspace: Workspace, options: dict[str, Any], stages: tuple[str, ...], *, force: bool = False) -> list[Step]:
    """The steps that `run` would take; stages that read the result of a stale one count as stale, too."""
    steps: list[Step] = []
    for stage in stages:
        due = [step.stage for step in reversed(steps) if step.reason]
        running = next((name for name in due if _runs_after(name, workspace, stage, options[stage])), None)
        if running and not force:
            reason = f"after {running}"
        else:
            reason = _reason_to_run(workspace, stage, options[stage], stages, force)
        if reason and not running:
            remade = [step for step in _remade_for(workspace, stage) if step.stage not in due]
            again = {step.stage for step in remade}
            steps = [step for step in steps if step.stage not in again] + remade
        steps.append(Step(stage, options[stage], reason))
    return steps


def require_inputs(workspace: Workspace, options: dict[str, Any], stages: tuple[str, ...] = STAGES) -> None:
    """Look for the capture and for all files that these stages need, before any of them changes anything.

    Raises:
        MissingInput, BadInput: a file is missing, or is not what it should be.
    """
    workspace.capture()
    for position, stage in enumerate(stages):
        stage_of(stage).require_named(workspace, options[stage])
        stage_of(stage).require_results(workspace, made=stages[:position])


def run(
    workspace: Workspace | Path | str,
    options: dict[str, Any] | None = None,
    stages: tuple[str, ...] = STAGES,
    *,
    force: bool = False,
    wait: bool = False,
    watcher: Watcher | None = None,
    report: bool = False,
    choices: Choices | None = None,
) -> None:
    """Run the stale ones of `stages` in order while holding the plant's lock (after a wait for it, if `wait`).

    Args:
        workspace: the plant, or the path of its folder or film.
        options: of every stage; by default those that the command `run` takes.
        choices: those with which the next run begins; by default these options.
        report: make the plant's page at the end, also after a failure, unless nothing has changed.
    Raises:
        Cotton3dgError: the first failure; results of earlier stages stay. If an input is missing, nothing has
        changed.
    """
    watcher = watcher or Watcher()
    if not isinstance(workspace, Workspace):
        workspace, _ = plant_and_options(Path(workspace), make=stages[:1] == STAGES[:1])
    options = options or choose(workspace).options
    require_inputs(workspace, options, () if wait else stages)
    with workspace.locked(wait=wait):
        require_inputs(workspace, options, stages)
        choices = choices or choices_of(workspace, options, stages)
        _run(workspace, options, stages, choices, force, watcher, report)


def _run(
    workspace: Workspace,
    options: dict[str, Any],
    stages: tuple[str, ...],
    choices: Choices,
    force: bool,
    watcher: Watcher,
    report: bool,
) -> None:
    failure = ""
    before, log_bytes, chosen_before = _records(workspace), _size(workspace.log_file), _last_choices(workspace)
    try:
        with _logged(workspace):
            workspace.drop_unfinished(STAGES)
            # Save the choices before a stage starts, so that an interrupted run continues with them.
            _keep(workspace, choices)
            watcher.begins(workspace, options, stages, force)
            for stage in stages:
                reason = _reason_to_run(workspace, stage, options[stage], stages, force)
                step = Step(stage, options[stage], reason)
                if not reason:
                    watcher.skipped(step)
                    continue
                for due in (*_remade_for(workspace, stage), step):
                    log.info("%s starts: %s", due.stage, due.reason)
                    record = _run_stage(workspace, due, watcher.started(due))
                    watcher.finished(due, record)
    except Cotton3dgError as error:
        failure = str(error)
        if _records(workspace) == before:
            report = False
            _keep(workspace, chosen_before)
            if isinstance(error, NOT_OF_THE_PLANT):
                _cut(workspace.log_file, log_bytes)
        raise
    finally:
        # Not after Ctrl-C: the user wants the run to end.
        if report and (failure or sys.exc_info()[0] is None):
            with _logged(workspace):
                _make_report(workspace, failure, watcher)


def _records(workspace: Workspace) -> list[Record | None]:
    return [workspace.read_record(stage) for stage in STAGES]


def _size(file: Path) -> int | None:
    return file.stat().st_size if file.is_file() else None


def _cut(file: Path, size: int | None) -> None:
    """Remove text appended to a file: a mistake that changed nothing does not belong to the plant's history."""
    with suppress(OSError):
        if size is None:
            file.unlink(missing_ok=True)
        else:
            os.truncate(file, size)


def _last_choices(workspace: Workspace) -> Choices | None:
    try:
        return Choices.load(workspace.choices_json)
    except BadInput:
        return None


def _keep(workspace: Workspace, choices: Choices | None) -> None:
    """Save the choices with which the next run begins; None = only the records of the stages give them."""
    if choices is None:
        workspace.choices_json.unlink(missing_ok=True)
    elif choices != _last_choices(workspace):
        workspace.keep(choices, workspace.choices_json.stem)


def begin(workspace: Workspace, stage: str, options: Any, watcher: Watcher) -> None:
    """Do the part of a stage that can be done beforehand, holding the plant's lock; its run goes on from there.

    Raises:
        Cotton3dgError: it failed; nothing is recorded.
    """
    known = stage_of(stage)
    assert known.begin
    with workspace.locked(), _logged(workspace):
        log.info("%s begins", stage)
        try:
            check_memory()
            known.begin(workspace, options, watcher.started(Step(stage, options, "the first part")))
        except Cotton3dgError as error:
            log.error("%s failed: %s", stage, error)
            raise
        except Exception as error:
            log.error("%s", traceback.format_exc())
            raise _explained(error, stage, workspace) from error


def _make_report(workspace: Workspace, failure: str, watcher: Watcher) -> None:
    """Make the plant's page; an error there is only a warning, because the result does not need the page."""
    try:
        from .report import page

        if page.is_stale(workspace, failure):
            page.make_report(workspace, failure)
            watcher.reported(f"see {workspace.report_html}")
    except Exception as error:
        log.warning("the report could not be made: %s", error, exc_info=True)
        watcher.reported(f"warning: could not be made ({error}); the results are not affected")


def _run_stage(workspace: Workspace, step: Step, progress: Progress) -> Record:
    """Run one stage and save its record, also if it fails; a mistake does not replace the record of a finished run."""
    stage = stage_of(step.stage)
    record = stage.record(step.options, step.reason)
    reset_peak_memory()
    wall_s, cpu_s = time.perf_counter(), cpu_seconds()
    failure: Cotton3dgError | None = None
    has_begun = False
    try:
        check_memory()
        check_disk(workspace, step.stage, step.options)
        has_begun = True
        record = replace(record, inputs=stage.input_hashes(workspace, step.options))
        outcome = stage.run(workspace, step.options, progress)
        record = record.done(outcome, workspace.hashes(workspace.folder(step.stage)))
    except Cotton3dgError as error:
        failure = error
    except Exception as error:
        log.error("%s", traceback.format_exc())
        failure = _explained(error, step.stage, workspace)
        failure.__cause__ = error
    record = replace(
        record,
        seconds=round(time.perf_counter() - wall_s, 3),
        cpu_seconds=round(cpu_seconds() - cpu_s, 3),
        peak_memory_mib=peak_memory_mib(),
    )
    if failure:
        finished, of_plant = workspace.read_record(step.stage), has_begun and not isinstance(failure, NOT_OF_THE_PLANT)
        if of_plant or not (finished and finished.is_ok):
            # The failure of the stage matters more than a failure to record it.
            with suppress(Cotton3dgError):
                workspace.write_record(replace(record, error=str(failure), exit_code=failure.exit_code))
        log.error("%s failed: %s", step.stage, failure)
        raise failure
    workspace.write_record(record)
    for warning in record.warnings:
        log.warning("%s: %s", step.stage, warning)
    log.info("%s done in %.1f s: %s", step.stage, record.seconds, record.summary)
    return record


def _explained(error: Exception, stage: str, workspace: Workspace) -> Cotton3dgError:
    """The meaning of an error that no stage foresaw."""
    if is_out_of_memory(error):
        return OutOfResources(
            f"{stage} ran out of memory; use --preset draft, fewer --jobs or a machine with more memory"
        )
    return StageFailed(f"{stage}: {type(error).__name__}: {error}; details are in {workspace.log_file.name}")


@contextmanager
def _logged(workspace: Workspace) -> Iterator[None]:
    """Append all log messages to the plant's run.log."""
    try:
        handler: logging.Handler = logging.FileHandler(workspace.log_file, encoding="utf-8", errors="backslashreplace")
    except OSError:
        handler = logging.NullHandler()  # the first stage will explain why nothing can be written
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    before = log.level, log.propagate
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    log.propagate = False
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(before[0])
        log.propagate = before[1]
        handler.close()


def status(workspace: Workspace, options: dict[str, Any]) -> list[StageState]:
    """The state of each stage with these options, and why it has to run."""
    return [
        state_of(step.stage, workspace.read_record(step.stage), step.reason)
        for step in plan(workspace, options, STAGES)
    ]
