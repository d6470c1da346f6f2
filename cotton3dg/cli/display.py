"""What the terminal shows: progress with an ETA, plans, states and the final row."""

from __future__ import annotations

import sys
import time
from collections import Counter
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from ..core.runs import Progress as StageProgress
from ..core.runs import State
from ..io.tables import read_rows
from ..options import STANDARD
from ..pipeline import Step, Watcher
from ..schemas.record import Record
from ..schemas.scale import ScaleInfo
from ..stage import STAGES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ..batch import Result
    from ..choices import Chosen
    from ..commands.correct import Outcome
    from ..commands.doctor import Finding
    from ..commands.import_ import Row as ImportRow
    from ..evaluation.masks import MaskCounts
    from ..evaluation.plant import BollMatches, TraitError
    from ..evaluation.plant_map import MapScores
    from ..schemas.check import CheckInfo
    from ..staleness import StageState
    from ..workspace import Workspace

PLAIN_INTERVAL_S: Final = 30.0
"""How often a line is printed where there is no terminal."""


class ProgressDisplay(Watcher):
    """Bars on a terminal; elsewhere one plain line every 30 s."""

    def __init__(self) -> None:
        self.console = Console(stderr=True)
        self.bars = Progress(
            TextColumn("{task.description:<8}"),
            BarColumn(bar_width=30),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[remark]}"),
            console=self.console,
        )

    def __enter__(self) -> ProgressDisplay:
        if self.console.is_terminal:
            self.bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.console.is_terminal:
            self.bars.stop()

    def started(self, step: Step) -> StageProgress:
        return self.watched(step.stage, step.reason)

    def watched(self, name: str, reason: str = "") -> StageProgress:
        """The progress of anything that takes a while."""
        return self._bar(name, reason) if self.console.is_terminal else self._lines(name, reason)

    def _bar(self, name: str, reason: str) -> StageProgress:
        task = self.bars.add_task(name, total=None, remark=reason)

        def show(done: int, total: int, remark: str = "") -> None:
            self.bars.update(task, completed=done, total=total, remark=remark)

        return show

    def _lines(self, name: str, reason: str) -> StageProgress:
        self._say(f"{name}: starts" + (f" ({reason})" if reason else ""))
        last = time.monotonic()
        begun: tuple[int, float] | None = None  # where an interrupted run goes on, some is done at the beginning

        def show(done: int, total: int, remark: str = "") -> None:
            nonlocal begun, last
            now = time.monotonic()
            begun = begun or (done, now)
            if now - last < PLAIN_INTERVAL_S or done == begun[0]:
                return
            last = now
            left_s = (now - begun[1]) * (total - done) / (done - begun[0])
            self._say(f"{name}: {done}/{total} {remark}, about {left_s:.0f} s left")

        return show

    def finished(self, step: Step, record: Record) -> None:
        facts = ", ".join(f"{key} {_short(value)}" for key, value in list(record.summary.items())[:4])
        self._say(f"{step.stage}: done in {record.seconds:.1f} s" + (f" ({facts})" if facts else ""))
        for warning in record.warnings:
            self._say(f"{step.stage}: warning: {warning}")

    def skipped(self, step: Step) -> None:
        self._say(f"{step.stage}: up to date")

    def reported(self, remark: str) -> None:
        self._say(f"report: {remark}")

    def _say(self, line: str) -> None:
        if self.console.is_terminal:
            self.console.print(line, markup=False, highlight=False)
        else:
            print(line, file=sys.stderr, flush=True)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def print_plan(steps: list[Step]) -> None:
    """One line a stage: whether it would run, and why."""
    for step in steps:
        print(f"{step.stage:<8} {'runs: ' + step.reason if step.reason else 'up to date'}")


def print_options(chosen: Chosen, stages: Iterable[str] = STAGES) -> None:
    """What is not usual about a plant's options, and how they differ from what its results were made with."""
    for word, text in (("options", chosen.summary()), ("changed since the last run", chosen.changes(stages))):
        if text:
            print(f"{word}: {text}", file=sys.stderr)


def status_entries(states: list[StageState], chosen: Chosen) -> list[dict[str, Any]]:
    """One entry a stage: state, why, preset, other options than the defaults, seconds, memory, flags, and so on."""
    values = chosen.by_stage()
    return [
        {
            "stage": item.stage,
            "state": item.state,
            "reason": item.reason,
            "preset": chosen.base.preset,
            "options": values[item.stage],
            "seconds": item.record and item.record.seconds,
            "peak_memory_mib": item.record and item.record.peak_memory_mib,
            "flags": item.record.flags if item.record else (),
            "warnings": item.record.warnings if item.record else (),
            "summary": item.record.summary if item.record else {},
        }
        for item in states
    ]


def print_status(states: list[StageState], chosen: Chosen) -> None:
    """A table of all stages."""
    table = Table(box=None, pad_edge=False)
    for heading in ("stage", "state", "seconds", "MiB", "remarks"):
        table.add_column(heading, justify="right" if heading in ("seconds", "MiB") else "left")
    with_preset = "" if chosen.base.preset == STANDARD else f" with {chosen.base.preset}"
    for entry in status_entries(states, chosen):
        remarks = "; ".join([entry["reason"], *entry["flags"]]).strip("; ")
        figures = ["" if entry[key] is None else f"{entry[key]:.1f}" for key in ("seconds", "peak_memory_mib")]
        state = f"{entry['state']}{with_preset if entry['state'] == State.DONE else ''}"
        table.add_row(entry["stage"], state, *figures, remarks)
    Console().print(table, markup=False)


def print_traits(workspace: Workspace) -> None:
    """The plant's row, one trait a line, the table that its lengths rest on, and where it is saved."""
    for row in read_rows(workspace.traits_csv):
        for name, value in row.items():
            print(f"{name:<26} {value}")
    scale = ScaleInfo.load_if_there(workspace.scale_json)
    if scale and scale.table_words:
        remedy = "; measure it, and give --set scale.table_length_cm=... --set scale.table_width_cm=..."
        print(scale.table_words + (remedy if scale.table_assumed else ""))
    print(f"saved as {workspace.traits_csv}")


def print_check(info: CheckInfo, plant_id: str, page: Path) -> None:
    """The verdict in its colour and why, on one line, and where to look."""
    word = Text(info.verdict.upper(), style=f"bold {info.verdict}")
    Console(soft_wrap=True).print(word.append(f" {plant_id}: {info.line}", style="not bold default"))
    print(f"see {page}")


def print_batch(results: list[Result], table: Path) -> None:
    """How many plants are done, the reasons of those that are not, and where the table is."""
    for result in results:
        if result.state != State.DONE:
            print(f"{result.folder}: {result.state}" + (f": {result.reason}" if result.reason else ""))
    print(f"{sum(result.state == State.DONE for result in results)} of {len(results)} plants done\nsaved as {table}")


def print_import(rows: list[ImportRow], into: Path, *, dry_run: bool) -> None:
    """What became of each video, doubts last, and how many there are of each kind."""
    for row in sorted(rows, key=lambda row: row.state == "doubt"):
        target = f" -> {row.folder}" if row.folder and row.state != "doubt" else ""
        print(f"{row.state:<9} {row.file}{target}" + (f": {row.reason}" if row.reason else ""))
    counts = Counter(row.state for row in rows)
    print(", ".join(f"{n} {state}" for state, n in counts.items()) + (" (dry run)" if dry_run else ""))
    if not dry_run:
        print(f"saved as {into / 'import.csv'}; next: cotton3dg batch {into}")


def print_corrections(outcome: Outcome) -> None:
    """What is kept of a plant, what does not apply, and what it changed."""
    for line in (*outcome.texts, *outcome.refused):
        print(line)
    print(f"{len(outcome.kept.corrections)} corrections kept; bolls: {outcome.before:g} -> {outcome.after:g}")


def print_findings(findings: list[Finding]) -> None:
    """What a machine has, and what to do about what it lacks."""
    for finding in findings:
        print(f"{'!' if finding.remedy else ' '} {finding.name:<32} {finding.found}")
        if finding.remedy:
            print(f"  {'':<32} -> {finding.remedy}")


def print_render(record: dict[str, Any], root: Path) -> None:
    """Size and speed of a film, and where it is saved."""
    print(
        f"{record['frames']} frames of {record['width']}x{record['height']} px, {record['n_gaussians']} Gaussians:"
        f" rendered at {record['fps_rendered']:.1f} a second on {record['threads']} threads"
        f" ({record['instruction_set']})\nsaved as {root / record['saved_as']}"
    )


def print_comparison(workspace: Workspace, truth_json: Path) -> None:
    """A plant's results beside its truth: traits, bolls and, where the truth has a skeleton, the plant map."""
    from ..evaluation.plant import evaluate
    from ..evaluation.plant_map import evaluate_map

    print_evaluation(*evaluate(workspace, truth_json))
    if map_scores := evaluate_map(workspace, truth_json):
        print_map_scores(map_scores)


def print_evaluation(errors: list[TraitError], bolls: BollMatches) -> None:
    """Measured beside true, one trait a line, and how many bolls were found."""
    print_trait_errors(errors)
    print(
        f"bolls: {bolls.n_matched} of {bolls.n_true} found, {bolls.n_measured - bolls.n_matched} false; "
        f"median distance {bolls.median_distance_cm:.2f} cm, volume error {bolls.mean_volume_error_pct:.1f} % (mean)"
        f" and {bolls.median_volume_error_pct:.1f} % (median)"
    )


def print_map_scores(map_scores: MapScores) -> None:
    """How the plant's map agrees with the true skeleton, one subject a line."""
    s = map_scores
    positions = f"; fruiting position right: {s.positions_right} of {s.positions}" if s.positions else ""
    print(
        f"fruiting branches: {s.matched_branches} of {s.true_branches} found,"
        f" {s.measured_branches - s.matched_branches} false (F1 {s.f1:.3f}); angle {s.angle_error_deg:.1f} deg,"
        f" length {s.length_error_pct:.1f} % off on average\n"
        f"bolls on their branch: {s.bolls_on_branch} of {s.bolls}, of those whose branch the map doubts"
        f" {s.doubtful_on_branch} of {s.doubtful}{positions}\n"
        f"first fruiting branch {s.first_height_error_cm:+.1f} cm, internode {s.internode_error_pct:+.1f} %,"
        f" stem length {s.stem_length_error_pct:+.1f} %, stem diameter {s.stem_diameter_error_mm:+.2f} mm"
    )


def print_trait_errors(errors: list[TraitError]) -> None:
    """Measured beside true, one trait a line."""
    print(f"{'trait':<27}{'measured':>10}{'truth':>10}{'error':>9}")
    for item in errors:
        print(f"{item.trait:<27}{item.measured:>10.2f}{item.truth:>10.2f}{item.error_pct:>8.1f}%")


def print_mask_scores(counts: MaskCounts, n_images: int) -> None:
    """Precision, recall and F1, one IoU a line, and mIoU."""
    print(f"{'IoU':<6}{'precision':>10}{'recall':>8}{'F1':>8}")
    for score in counts.scores:
        print(f"{score.iou:<6.2f}{score.precision:>10.3f}{score.recall:>8.3f}{score.f1:>8.3f}")
    print(f"mIoU {counts.miou_hits:.3f} of the hits at 0.5, {counts.miou_all:.3f} of all {counts.n_true} true masks")
    print(f"{n_images} images judged")
