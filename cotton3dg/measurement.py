# SPDX-License-Identifier: Apache-2.0
"""From films to tables in one call, for scripts and notebooks: one plant, or all plants of a folder."""

from __future__ import annotations

import html
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from . import pipeline
from .batch import INDEX, Batch, default_jobs, find_plants, require_named
from .choices import Asked, choose, plant_and_options
from .cli import display, progress
from .core.runs import State
from .errors import BadUsage, Cotton3dgError, unknown
from .field.tables import BATCH_COLUMNS, BOLL_TABLE, TABLE
from .io.tables import BOLLS, BRANCHES, TRAITS, flags_of, frame_of, read_rows
from .option_rules import places
from .options import STAGE_OPTIONS
from .report.facts import read_facts
from .report.index import SHOWN
from .report.pictures import Pictures
from .report.verdicts import interval_of, rounded
from .stage import STAGES
from .workspace import Workspace

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False, repr=False)
class Measurement:
    """What was measured of a plant, or of all plants of a folder. A notebook shows it as a table, a plant with a photo.

    In the tables a text that is not known is "", a number NaN.
    """

    traits: DataFrame
    """A row per plant: the columns of traits.csv, or of a folder those of batch.csv."""
    bolls: DataFrame
    """A row per boll, as bolls.csv."""
    branches: DataFrame
    """A row per branch, as branches.csv."""
    report: Path
    """The page to look at."""
    plant: Workspace | None = None
    """The plant's folder; None for a folder of plants."""

    def __repr__(self) -> str:
        return f"{self._shown().to_string()}\nreport: {self.report}"

    def _repr_html_(self) -> str:
        import pandas as pd

        with pd.option_context("display.max_colwidth", None):  # else it cuts the reasons of failures
            table = self._shown().to_html()
        link = f'<a href="{html.escape(quote(self.report.as_posix()))}">{html.escape(str(self.report))}</a>'
        return f"{self._picture()}{table}<p>report: {link}</p>"

    def _shown(self) -> DataFrame:
        """A line per plant: the four traits with their 95 % intervals, and flags or the reason of a failure."""
        import pandas as pd

        rows = self.traits.to_dict("records")
        lines = [
            {
                f"{name}, {unit}" if unit else name: _with_interval(row, trait, digits)
                for trait, (name, unit, digits) in SHOWN.items()
            }
            | {"Remarks": row.get("reason") or ", ".join(flags_of(row))}
            for row in rows
        ]
        return pd.DataFrame(lines, [row["plant_id"] or row["folder"] for row in rows])

    def _picture(self) -> str:
        """A photo with every boll numbered, as the report has it; empty without bolls or when the photos are gone."""
        if self.plant is None:
            return ""
        try:
            pictures = Pictures(self.plant, read_facts(self.plant)).counted()
        except Cotton3dgError:
            pictures = []
        sources = [picture["src"] for picture in pictures[:1]]
        return "".join(f'<img src="{source}" alt="bolls, numbered" style="max-width: 100%">' for source in sources)


def measure(
    plant: Workspace | Path | str,
    preset: str | None = None,
    *,
    reset: bool = False,
    force: bool = False,
    quiet: bool = False,
    **options: Mapping[str, Any],
) -> Measurement:
    """Measure a plant as `cotton3dg run` does: only what is out of date is made again.

    Args:
        plant: its folder or its film.
        preset: as of the command line; by default that of the plant's last run.
        reset: leave the last run's options for the defaults.
        force: run even what is up to date.
        quiet: print no progress.
        options: those of a stage by their names, as in `train={"steps": 3000}`. They win over every file.
    Raises:
        Cotton3dgError: the film or an option is refused, or a stage failed; the text says what to do.
    """
    asked = _asked("measure", preset, reset, options)
    workspace, chosen = plant_and_options(plant.root if isinstance(plant, Workspace) else Path(plant), asked, make=True)
    how: dict[str, Any] = {"force": force, "report": True, "choices": chosen.to_keep(STAGES)}
    if quiet:
        pipeline.run(workspace, chosen.options, **how)
    else:
        display.tell_options(chosen, progress.teller(None))
        with progress.ProgressDisplay() as watcher:
            pipeline.run(workspace, chosen.options, watcher=watcher, **how)
    return Measurement(
        frame_of(read_rows(workspace.traits_csv), TRAITS),
        frame_of(read_rows(workspace.bolls_csv), BOLLS),
        frame_of(read_rows(workspace.branches_csv), BRANCHES),
        workspace.report_html,
        workspace,
    )


def measure_many(
    folder: Path | str,
    preset: str | None = None,
    *,
    jobs: int = 0,
    reset: bool = False,
    quiet: bool = False,
    **options: Mapping[str, Any],
) -> Measurement:
    """Measure every plant below a folder as `cotton3dg batch` does; a plant that fails has a row with the reason.

    Args:
        jobs: plants side by side; 0 = as many as cores and memory allow.
        preset, reset, quiet, options: as of `measure`, for all plants.
    Raises:
        Cotton3dgError: no plant is there, or an option is refused.
    """
    asked, folder = _asked("measure_many", preset, reset, options), Path(folder)
    plants = find_plants(folder)
    require_named(plants, choose(None, asked, folder).options)
    work = Batch(folder, asked.arguments, jobs or default_jobs(), tell=_unheard if quiet else _tell)
    done = [result.folder for result in work.run(plants) if result.state == State.DONE]
    branches = [row for name in done for row in read_rows(Workspace(folder / name).branches_csv)]
    return Measurement(
        frame_of(read_rows(folder / TABLE), BATCH_COLUMNS),
        frame_of(read_rows(folder / BOLL_TABLE), BOLLS),
        frame_of(branches, BRANCHES),
        folder / INDEX,
    )


def _asked(by: str, preset: str | None, reset: bool, options: Mapping[str, Any]) -> Asked:
    """What a call asks for.

    Raises:
        BadUsage: an option has no stage, or a stage has no names of options.
    """
    for name, given in options.items():
        if name not in STAGE_OPTIONS:
            of = [stage for stage, kind in STAGE_OPTIONS.items() if name in {place.name for place in places(kind)}]
            if of:
                raise BadUsage(f"{name} is an option of {' and '.join(of)}; write {of[0]}={{{name!r}: {given!r}}}")
            raise unknown(f"stage {name!r}", name, STAGE_OPTIONS)
        if not isinstance(given, Mapping):
            raise BadUsage(f"{name} = {given!r} names no option; write it as train={{'steps': 3000}}")
    return Asked(preset, reset, options, by=by)


def _with_interval(row: Mapping[str, Any], trait: str, digits: int) -> str:
    """`73.8 (73.1 to 74.5)`; without the interval where that is a point or not known, a dash without a value."""
    value, low, high = (rounded(number, digits) if math.isfinite(number) else "" for number in interval_of(row, trait))
    return f"{value} ({low} to {high})" if low != high else value or "–"


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _unheard(line: str) -> None:
    """Says nothing."""
