# SPDX-License-Identifier: Apache-2.0
"""`run`: what a run ends with; and `--repeat`, how much a row depends on frames and on chance in training."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from .. import pipeline
from ..errors import BadUsage
from ..evaluation.repeatability import Repeats, repeat
from ..evaluation.repeatability_page import write_repeats
from ..io.tables import TRAITS, value_of
from ..report.advice import meaning
from ..report.facts import read_facts
from ..report.page import trait_cards
from ..report.verdicts import USUAL_PCT, sureness_of
from ..scale.estimate_scale import TABLE_SIZE_ASSUMED
from ..schemas.frames import FramesInfo
from ..workspace import Workspace

MEASURE: Final = "measure it, and give --set scale.table_length_cm=... --set scale.table_width_cm=..."


@dataclass(frozen=True)
class Ending:
    """What a run has measured, in the words of the plant's report."""

    plant_id: str
    problem: str
    """Why there are no traits to show, as after a part of a run on results that are out of date; empty if there are."""
    cards: list[dict[str, str]]
    """The four traits, as the report shows them: name, value, unit, range, sure, sureness, note."""
    row: dict[str, str]
    """Column -> cell of traits.csv."""
    table: str
    """The table on which lengths rest, and how to be surer of it; empty if they rest on none."""
    flags: dict[str, str]
    """Quality flag -> its title in the report; without that of an assumed table, which `table` tells."""
    report: Path | None
    traits_csv: Path

    def as_json(self) -> dict[str, Any]:
        """The same for programs; `sureness` has green, yellow or red for each of the traits, null where it is blank."""
        return {
            "plant_id": self.plant_id,
            "problem": self.problem,
            "traits": {column.name: value_of(self.row.get(column.name, ""), column) for column in TRAITS},
            "sureness": {column: sureness_of(self.row, column) for column in USUAL_PCT},
            "table": self.table,
            "flags": self.flags,
            "report": self.report and str(self.report),
            "saved_as": str(self.traits_csv),
        }


def read_ending(workspace: Workspace) -> Ending:
    """The results of a plant after a run that reached its traits."""
    facts = read_facts(workspace)
    scale = facts.scale
    words = scale.table_words if scale else ""
    return Ending(
        plant_id=facts.plant_id,
        problem=facts.failure,
        cards=trait_cards(facts),
        row=facts.traits,
        table=f"{words}; {MEASURE}" if scale and words and scale.table_assumed else words,
        flags={flag: meaning(flag).title for flag in facts.flags if not (words and flag == TABLE_SIZE_ASSUMED)},
        report=workspace.report_html if workspace.report_html.is_file() else None,
        traits_csv=workspace.traits_csv,
    )


def repeat_runs(
    workspace: Workspace,
    options: dict[str, Any],
    times: int,
    tell: Callable[[str], None],
    watcher: pipeline.Watcher | None = None,
) -> Repeats:
    """Run a finished plant's capture `times` more times and compare the runs with it; tables and picture in `repeats/`.

    Each run has one frame fewer than the run before and another seed of training. Frames stand at even steps of the
    way, so that one frame fewer moves all but the first and the last. The runs show nothing about what they share: the
    film itself, its light, and the size of the table.

    Raises:
        BadUsage: the model was trained elsewhere, on frames that the user gave.
        Cotton3dgError: a run failed, or cannot be compared.
    """
    if options["train"].model:
        raise BadUsage("--repeat trains anew; leave out train.model")
    n_frames = len(FramesInfo.load(workspace.frames_json).images)
    runs = [workspace]
    for number in range(1, times + 1):
        tell(f"run {number} of {times} for --repeat")
        again = workspace.repeat_run(number)
        workspace.share_inputs(again)
        changed = {
            "frames": replace(options["frames"], count=n_frames - number),
            "train": replace(options["train"], seed=options["train"].seed + number),
        }
        pipeline.run(again, options | changed, watcher=watcher)
        runs.append(again)
    repeats = repeat([run.root for run in runs], turn_deg=0.0)
    write_repeats(workspace.repeats, repeats)
    return repeats
