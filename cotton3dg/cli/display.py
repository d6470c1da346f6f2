# SPDX-License-Identifier: Apache-2.0
"""What the terminal shows of results: plans, states, the four traits, comparisons."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ..core.runs import State
from ..io.saving import json_text, printable
from ..options import STANDARD
from ..pipeline import Step
from ..schemas.check import GREEN, RED, YELLOW
from ..stage import STAGES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from ..batch import Result
    from ..choices import Chosen
    from ..commands.correct import Outcome
    from ..commands.doctor import Finding
    from ..commands.import_ import Row as ImportRow
    from ..commands.run import Ending
    from ..evaluation.masks import MaskCounts
    from ..evaluation.plant import BollMatches, TraitError
    from ..evaluation.plant_map import MapScores
    from ..schemas.check import CheckInfo
    from ..staleness import StageState
    from ..workspace import Workspace

MARKS: Final = {GREEN: "●", YELLOW: "■", RED: "◆"}
"""Marks of how sure a trait is; their shapes are those of the pages."""
WORDS_FROM: Final = 60
"""Width of a terminal from which words stand beside the marks."""
STYLES: Final = {State.FAILED: "red", State.STALE: "yellow"}
"""Colours of states that need somebody; the others have none."""


def print_json(content: Any) -> None:
    """Results for programs; what is not known is null."""
    print(json_text(content), end="")


def print_plan(steps: list[Step], *, as_json: bool) -> None:
    """One line a stage: whether it would run, and why."""
    if as_json:
        print_json([{"stage": step.stage, "runs": bool(step.reason), "reason": step.reason} for step in steps])
        return
    for step in steps:
        print(f"{step.stage:<8} {'runs: ' + step.reason if step.reason else 'up to date'}")


def tell_options(chosen: Chosen, tell: Callable[[str], None], stages: Iterable[str] = STAGES) -> None:
    """Tell what is not usual about a plant's options, and how they differ from what its results were made with."""
    for word, text in (("options", chosen.summary()), ("changed since the last time", chosen.changes(stages))):
        if text:
            tell(f"{word}: {text}")


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


def print_status(states: list[StageState], chosen: Chosen, *, as_json: bool) -> None:
    """A table of all stages."""
    if as_json:
        print_json(status_entries(states, chosen))
        return
    table = Table(box=None, pad_edge=False)
    for heading in ("stage", "state", "seconds", "MiB", "remarks"):
        table.add_column(heading, justify="right" if heading in ("seconds", "MiB") else "left")
    with_preset = "" if chosen.base.preset == STANDARD else f" with {chosen.base.preset}"
    for entry in status_entries(states, chosen):
        remarks = "; ".join([entry["reason"], *entry["flags"]]).strip("; ")
        figures = ["" if entry[key] is None else f"{entry[key]:.1f}" for key in ("seconds", "peak_memory_mib")]
        state = _coloured(entry["state"]).append(with_preset if entry["state"] == State.DONE else "", style="default")
        table.add_row(entry["stage"], state, *figures, Text(remarks))
    Console().print(table)


def print_batch_status(results: list[Result], *, as_json: bool) -> None:
    """A table of all plants, as `print_status` has one of stages, and how many are done."""
    if as_json:
        print_json([vars(result) | {"folder": printable(result.folder)} for result in results])
        return
    table = Table(box=None, pad_edge=False)
    for heading in ("plant", "state", "remarks"):
        table.add_column(heading)
    for result in results:
        table.add_row(Text(printable(result.folder)), _coloured(result.state), Text(result.reason))
    Console().print(table)
    print(_done(results))


def _coloured(state: State) -> Text:
    return Text(state, style=STYLES.get(state, "default"))


def print_ending(ending: Ending, *, everything: bool = False, as_json: bool = False) -> None:
    """The four traits with their intervals and how sure they are, the table, the flags, and where all the rest is.

    Args:
        everything: print each column of the plant's row instead of the four traits.
    """
    if as_json:
        print_json(ending.as_json())
        return
    if everything:
        for name, value in ending.row.items():
            print(f"{name:<26} {value}")
    elif ending.cards:
        console = Console()
        console.print(_trait_table(ending, in_words=console.width >= WORDS_FROM))
    if ending.problem:
        print(ending.problem)
    if ending.table:
        print(ending.table)
    for title in ending.flags.values():
        _print_styled("! ", "yellow", title)
    if ending.report:
        print(f"report: {ending.report}")
    print(f"saved as {ending.traits_csv}" + ("" if everything else "; --all prints every column"))


def _trait_table(ending: Ending, *, in_words: bool) -> Table:
    """One trait a line; a mark, and words if there is room, say how sure it is, by the report's rule."""
    table = Table(box=None, pad_edge=False, padding=(0, 2 if in_words else 1, 0, 0))
    table.add_column(Text(ending.plant_id), no_wrap=True)
    table.add_column("", justify="right", no_wrap=True)
    table.add_column("95 % interval")
    table.add_column("")
    for card in ending.cards:
        sure = card["sure"]
        interval = card["range"] or (f"{card['value']} to {card['value']}" if sure else "")
        mark = Text(f"{MARKS[sure]} ", style=sure) if sure else Text("  ")
        value = Text(f"{card['value']} {card['unit']}".strip(), style="bold")
        remark = "" if sure and not in_words else card["sureness"] or card["note"]
        table.add_row(mark.append(card["name"], style="default"), value, interval, remark)
    return table


def _print_styled(word: str, style: str, rest: str) -> None:
    """A line whose first word is coloured where there is a terminal; it is never broken."""
    Console(soft_wrap=True, highlight=False).print(Text(word, style=style).append(rest, style="not bold default"))


def print_check(info: CheckInfo, plant_id: str, page: Path) -> None:
    """The verdict in its colour and why, on one line, and where to look."""
    _print_styled(info.verdict.upper(), f"bold {info.verdict}", f" {plant_id}: {info.line}")
    print(f"see {page}")


def print_batch(results: list[Result], table: Path, *, as_json: bool) -> None:
    """How many plants are done, the reasons of those that are not, and where the table is."""
    if as_json:
        print_json([vars(result) for result in results])
        return
    for result in results:
        if result.state != State.DONE:
            print(f"{result.folder}: {result.state}" + (f": {result.reason}" if result.reason else ""))
    print(f"{_done(results)}\nsaved as {table}")


def _done(results: list[Result]) -> str:
    return f"{sum(result.state == State.DONE for result in results)} of {len(results)} plants done"


def print_import(rows: list[ImportRow], into: Path, *, dry_run: bool, as_json: bool) -> None:
    """What became of each video, doubts last, and how many there are of each kind."""
    if as_json:
        print_json([vars(row) for row in rows])
        return
    for row in sorted(rows, key=lambda row: row.state == "doubt"):
        target = f" -> {row.folder}" if row.folder and row.state != "doubt" else ""
        print(f"{row.state:<9} {row.file}{target}" + (f": {row.reason}" if row.reason else ""))
    counts = Counter(row.state for row in rows)
    print(", ".join(f"{n} {state}" for state, n in counts.items()) + (" (dry run)" if dry_run else ""))
    if not dry_run:
        print(f"saved as {into / 'import.csv'}; next: cotton3dg batch {into}")


def print_corrections(outcome: Outcome, *, as_json: bool) -> None:
    """What is kept of a plant, what does not apply, and what it changed."""
    if as_json:
        print_json(
            {
                "corrections": [asdict(correction) for correction in outcome.kept.corrections],
                "refused": outcome.refused,
                "ruler_lengths": [length and asdict(length) for length in outcome.lengths],
                "bolls_before": outcome.before,
                "bolls_after": outcome.after,
            }
        )
        return
    for line in (*outcome.texts, *outcome.refused):
        print(line)
    kept = len(outcome.kept.corrections)
    print(f"{kept} {'correction' if kept == 1 else 'corrections'} kept; {outcome.change}")


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


def print_comparison(workspace: Workspace, truth_json: Path, *, as_json: bool = False) -> None:
    """A plant's results beside its truth: traits, bolls and, where the truth has a skeleton, the plant map."""
    from ..evaluation.plant import evaluate
    from ..evaluation.plant_map import evaluate_map

    print_evaluation(*evaluate(workspace, truth_json), evaluate_map(workspace, truth_json), as_json=as_json)


def print_evaluation(
    errors: list[TraitError],
    bolls: BollMatches | None = None,
    map_scores: MapScores | None = None,
    *,
    as_json: bool,
) -> None:
    """Measured beside true, one trait a line, how many bolls were found, and how the plant's map agrees."""
    if as_json:
        traits = [asdict(item) | {"error_pct": item.error_pct} for item in errors]
        print_json({"traits": traits, "bolls": bolls and asdict(bolls), "map": map_scores and asdict(map_scores)})
        return
    print_trait_errors(errors)
    if bolls:
        print_boll_matches(bolls)
    if map_scores:
        print_map_scores(map_scores)


def print_boll_matches(bolls: BollMatches) -> None:
    """How many bolls were found, and how right they are."""
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


def print_mask_scores(counts: MaskCounts, n_images: int, *, as_json: bool) -> None:
    """Precision, recall and F1, one IoU a line, and mIoU."""
    if as_json:
        scores = [asdict(score) for score in counts.scores]
        miou = {"miou_hits": counts.miou_hits, "miou_all": counts.miou_all}
        print_json({"scores": scores, **miou, "n_true": counts.n_true, "n_images": n_images})
        return
    print(f"{'IoU':<6}{'precision':>10}{'recall':>8}{'F1':>8}")
    for score in counts.scores:
        print(f"{score.iou:<6.2f}{score.precision:>10.3f}{score.recall:>8.3f}{score.f1:>8.3f}")
    print(f"mIoU {counts.miou_hits:.3f} of the hits at 0.5, {counts.miou_all:.3f} of all {counts.n_true} true masks")
    print(f"{n_images} images judged")
