# SPDX-License-Identifier: Apache-2.0
"""Tries the settings of a study on one plant, as far as time permits.

Each setting has a plant's folder of its own below study/. It starts with the finished stages of the base setting, so
that only the stages that the setting changes run; seconds still count all stages. Whatever is finished stays.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from .. import pipeline
from ..core.machine import usable_cores
from ..core.runs import State
from ..errors import BadUsage, Cotton3dgError
from ..evaluation.plant import evaluate
from ..io.encode import crop_video
from ..io.saving import explain_disk_errors, replacing, write_text_atomically
from ..io.tables import csv_text
from ..pipeline import Step, Watcher
from ..planning.cost import estimate_costs, examine_footage
from ..planning.tradeoff import format_duration, typical_ratio
from ..schemas.train import TrainMetrics
from ..stage import STAGES, stage_of
from ..staleness import stale_reason
from ..workspace import Workspace
from .checkpoints import save_intermediate_models
from .plant_region import PlantRegions
from .rows import empty_row, finished_row
from .settings import PARTIAL_SHARE, Setting, settings_of
from .tables import COLUMNS, markdown, with_errors, write_plot

Tell = Callable[[str], None]


class Study:
    """A study at work; its tables and picture are right at any time."""

    def __init__(
        self,
        plant: Workspace,
        preset: str = "draft",
        overrides: Mapping[str, Mapping[str, Any]] | None = None,
        *,
        budget_s: float = math.inf,
        truth_json: Path | None = None,
        lpips: Path | None = None,
        local: Workspace | None = None,
        watcher: Watcher | None = None,
        tell: Tell = print,
    ):
        self.plant, self.preset, self.overrides = plant, preset, overrides or {}
        self.watcher, self.tell = watcher or Watcher(), tell
        self.lpips, self.local = lpips, local
        self.regions = PlantRegions()
        self.source = examine_footage(plant)
        options = pipeline.stage_options(plant, preset, {stage: dict(own) for stage, own in self.overrides.items()})
        self.base = Setting("base", preset, options)
        self.truth_json = truth_json or (plant.truth_json if plant.truth_json.is_file() else None)
        self.truth: dict[str, float] = {}
        self.rows: dict[tuple[str, str], dict[str, Any]] = {}
        self.ends = time.monotonic() + budget_s
        self.timed: dict[str, list[tuple[float, float]]] = defaultdict(list)
        """Stage -> measured and modelled seconds of each finished setting."""

    def run(self, sweeps: Mapping[str, Sequence[str]]) -> list[dict[str, Any]]:
        """Try the settings of all sweeps, the base first; returns the rows of the tables.

        Args:
            sweeps: name -> values; none = the usual ones.
        Raises:
            Cotton3dgError: the base setting fails or does not fit into the time.
        """
        tables = {
            sweep: settings_of(
                sweep, self.plant, self.preset, self.overrides, self.source, values, local=self.local is not None
            )
            for sweep, values in sweeps.items()
        }
        with self.plant.locked():
            self._run_base()
            for sweep, settings in tables.items():
                if sweep == "steps":
                    self._train_through(settings)
                for setting in settings:
                    self._try(setting)
                    self._save()
        return self._rows_with_errors()

    # --------------------------------------------------------------- settings
    def _run_base(self) -> None:
        needed_s = self._needed_s(self.base)
        if needed_s > self._left_s():
            raise BadUsage(
                f"the base setting alone takes about {format_duration(needed_s)}; give a longer --time-budget"
            )
        workspace = self._workspace(self.base)
        pipeline.run(workspace, self.base.options, watcher=self.watcher)
        if self.truth_json:
            self.truth = {item.trait: item.truth for item in evaluate(workspace, self.truth_json)[0]}
        self._note(self.base, workspace)
        self._save()

    def _try(self, setting: Setting) -> None:
        if setting.obstacle:
            self._leave_out(setting, setting.obstacle)
            return
        if setting.is_base:
            row = self.rows[self.base.sweep, self.base.value]
            self.rows[setting.sweep, setting.value] = {**row, "sweep": setting.sweep, "setting": setting.value}
            return
        needed_s = self._needed_s(setting)
        if needed_s > self._left_s():
            left_s = max(0.0, self._left_s())
            self._leave_out(setting, f"about {format_duration(needed_s)} needed, {format_duration(left_s)} left")
            return
        self.tell(
            f"{setting.sweep} {setting.value}: " + (f"about {format_duration(needed_s)}" if needed_s else "finished")
        )
        try:
            workspace = self._workspace(setting)
            if needed_s:
                pipeline.run(workspace, setting.options, watcher=self.watcher)
            self._note(setting, workspace)
        except Cotton3dgError as error:
            self.rows[setting.sweep, setting.value] = empty_row(setting.sweep, setting.value, State.FAILED, str(error))
            self.tell(f"{setting.sweep} {setting.value}: failed: {error}")

    def _leave_out(self, setting: Setting, reason: str) -> None:
        self.rows[setting.sweep, setting.value] = empty_row(setting.sweep, setting.value, State.SKIPPED, reason)
        self.tell(f"{setting.sweep} {setting.value}: skipped: {reason}")

    def _workspace(self, setting: Setting) -> Workspace:
        """The setting's folder, with what other folders have finished for it."""
        workspace = self.plant.study_setting(setting.sweep, setting.value)
        if setting.partial and self.local:
            self.local.share_inputs(workspace)
            return workspace
        if setting.partial:
            cropped = workspace.root / "partial.mp4"
            if not cropped.exists():
                with replacing(cropped) as path:
                    crop_video(self.plant.capture(), path, PARTIAL_SHARE)
            return workspace
        self.plant.share_inputs(workspace)
        base = self.plant.study_setting(self.base.sweep, self.base.value)
        donors = [self.plant] if setting is self.base else [base, self.plant]
        for stage in STAGES:
            # A model that a training passes through is not its final model, although the options are the same.
            if (setting.passing and stage == "train") or not self._is_due(workspace, setting, stage):
                continue
            read = stage_of(stage).input_hashes(workspace, setting.options[stage])
            for donor in donors:
                record = donor.read_record(stage)
                if record and record.inputs == read and not self._is_due(donor, setting, stage):
                    donor.share_result(stage, workspace)
                    break
        return workspace

    @staticmethod
    def _is_due(workspace: Workspace, setting: Setting, stage: str) -> bool:
        return bool(stale_reason(workspace, stage, setting.options[stage]))

    def _train_through(self, settings: Sequence[Setting]) -> None:
        """One training that leaves its model in the folders of all settings, unless they have it."""
        passing = [setting for setting in settings if setting.passing]
        workspaces = {int(setting.value): self._workspace(setting) for setting in passing}
        if not any(self._is_due(workspaces[int(setting.value)], setting, "train") for setting in passing):
            return
        needed_s = self._stage_s(passing[0], "train")
        if needed_s > self._left_s():
            return
        self.tell(f"steps: one training, about {format_duration(needed_s)}")
        options = passing[0].options["train"]
        base = self._workspace(self.base)
        progress = self.watcher.started(Step("train", options, "its models are kept"))
        outcomes = save_intermediate_models(base, options, workspaces, progress)
        base_record = base.read_record("train")
        for steps, outcome in outcomes.items():
            workspace = workspaces[steps]
            reached = TrainMetrics.load(workspace.metrics_json)
            record = replace(
                stage_of("train").record(options, f"after {steps} of {options.steps} steps"),
                inputs=stage_of("train").input_hashes(workspace, options),
                seconds=reached.seconds,
                cpu_seconds=reached.cpu_seconds,
                peak_memory_mib=base_record.peak_memory_mib if base_record else math.nan,
            )
            workspace.write_record(record.done(outcome, workspace.hashes(workspace.folder("train"))))

    # ------------------------------------------------------------------- time
    def _left_s(self) -> float:
        return self.ends - time.monotonic()

    def _stage_s(self, setting: Setting, stage: str) -> float:
        """The time that a stage will take: as modelled, corrected by the times so far."""
        modelled = estimate_costs(setting.options, self.source)[stage].seconds(len(usable_cores()))
        return typical_ratio(self.timed[stage]) * modelled

    def _needed_s(self, setting: Setting) -> float:
        """Seconds until the setting is finished; 0 when it is."""
        workspace = self._workspace(setting)
        due = [stage for stage in STAGES if self._is_due(workspace, setting, stage)]
        due = [
            stage for stage in STAGES if stage in due or stage_of(stage).follows(workspace, setting.options[stage], due)
        ]
        if setting.passing and "train" in due:  # the training left no time for the rest
            return math.inf
        return sum(self._stage_s(setting, stage) for stage in due)

    # ------------------------------------------------------------------- rows
    def _note(self, setting: Setting, workspace: Workspace) -> None:
        """Add the finished setting's row, and learn from the seconds of its stages."""
        modelled = estimate_costs(setting.options, self.source)
        for stage in STAGES:
            record = workspace.read_record(stage)
            if record and not (setting.passing and stage == "train"):
                self.timed[stage].append((record.seconds, modelled[stage].seconds(len(usable_cores()))))
        row = finished_row(workspace, setting.sweep, setting.value, setting.options["train"], self.regions, self.lpips)
        self.rows[setting.sweep, setting.value] = row

    def _rows_with_errors(self) -> list[dict[str, Any]]:
        """All rows with their errors, a sweep after the other."""
        sweeps = dict.fromkeys(sweep for sweep, _ in self.rows)
        by_sweep = [[row for key, row in self.rows.items() if key[0] == sweep] for sweep in sweeps]
        return [row for rows in by_sweep for row in with_errors(rows, self.truth)]

    def _save(self) -> None:
        rows = self._rows_with_errors()
        write_text_atomically(self.plant.study_csv, csv_text(COLUMNS, rows))
        write_text_atomically(self.plant.study_md, markdown(rows))
        with explain_disk_errors(self.plant.root):
            write_plot(self.plant.study_plot, rows)
