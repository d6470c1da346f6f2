# SPDX-License-Identifier: Apache-2.0
"""Commands on one plant: the run, its stages one by one, and what is made of them; parse, call, print, no logic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from ..command_options import ENGINES
from ..core.runs import State
from ..errors import SOME_FAILED, BadUsage, unknown
from ..options import STAGE_OPTIONS
from .arguments import (
    AsJson,
    Force,
    Loud,
    NoReport,
    PlantDir,
    Preset,
    Reset,
    Set,
    TimeBudget,
    add_flags,
    choice,
    given,
    keep_given,
    parse_overrides,
    report_errors,
)

if TYPE_CHECKING:
    from ..choices import Asked
    from ..planning.time_budget import Budget
    from ..workspace import Workspace

STAGES: Final = tuple(STAGE_OPTIONS)
"""As in `stage.py`, which imports too much for a quick help."""


def run(
    plant_dir: PlantDir,
    from_: Annotated[str, choice("--from", known=STAGES, help="first stage", default=STAGES[0])] = STAGES[0],
    until: Annotated[str, choice("--until", known=STAGES, help="last stage", default=STAGES[-1])] = STAGES[-1],
    preset: Preset = None,
    reset: Reset = False,
    force: Force = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="only say what would run, and why")] = False,
    wait: Annotated[bool, typer.Option("--wait", help="for another run of this plant, instead of failing")] = False,
    time_budget: TimeBudget = None,
    no_report: NoReport = False,
    repeat: Annotated[int, typer.Option(min=0, help="more runs, of other frames, to see how far they agree")] = 0,
    set_: Set = None,
    everything: Annotated[bool, typer.Option("--all", help="print every column of the row")] = False,
    as_json: AsJson = False,
    loud: Loud = None,
) -> None:
    """Measure a plant, from its video to traits.csv; run again only what is stale."""
    from .. import pipeline
    from ..choices import Asked, plant_and_options
    from . import display, progress

    with report_errors(plant_dir):
        asked, stages = Asked(preset, reset, parse_overrides(set_)), pipeline.selected(from_, until)
        if repeat and stages != STAGES:
            raise BadUsage("--repeat is for whole runs; leave out --from and --until")
        if time_budget and (preset or stages != STAGES):
            raise BadUsage("--time-budget chooses for the whole run; leave out --preset, --from and --until")
        workspace, chosen = plant_and_options(plant_dir, asked, make=stages[0] == STAGES[0] and not dry_run)
        tell = progress.teller(loud)
        budget = _budget(workspace, time_budget, asked, tell) if time_budget else None
        chosen = budget.chosen if budget else chosen
        display.tell_options(chosen, tell, stages)
        if dry_run:
            pipeline.require_inputs(workspace, chosen.options, stages)
            display.print_plan(pipeline.plan(workspace, chosen.options, stages, force=force), as_json=as_json)
            return
        with progress.ProgressDisplay(loud, STAGES if budget else ()) as watcher:
            how: dict[str, Any] = {"force": force, "wait": wait, "watcher": watcher, "report": not no_report}
            if budget:
                budget.run(**how)
            else:
                pipeline.run(workspace, chosen.options, stages, choices=chosen.to_keep(stages), **how)
        if "traits" in stages:
            from ..commands.run import read_ending

            display.print_ending(read_ending(workspace), everything=everything, as_json=as_json)
        if repeat:
            from ..commands.run import repeat_runs
            from ..evaluation.repeatability import repeats_text

            with progress.ProgressDisplay(loud) as watcher:
                repeats = repeat_runs(workspace, chosen.options, repeat, tell, watcher)
            typer.echo(f"{repeats_text(repeats)}\nsaved in {workspace.repeats}", err=as_json)


def _budget(workspace: Workspace, time: str, asked: Asked, tell: Callable[[str], None]) -> Budget:
    from ..planning.calibrate import read_or_calibrate
    from ..planning.time_budget import Budget
    from ..planning.tradeoff import parse_duration

    return Budget(workspace, parse_duration(time), read_or_calibrate(tell), asked, tell)


def batch(
    folder: Annotated[Path, given(help="folder with a folder for each plant")],
    jobs: Annotated[int, typer.Option(help="plants side by side; 0 = as many as cores and memory allow")] = 0,
    preset: Preset = None,
    reset: Reset = False,
    retry: Annotated[int, typer.Option(help="more tries for plants that a fault of the machine stopped")] = 0,
    only_failed: Annotated[bool, typer.Option("--only-failed", help="those that batch.csv calls failed")] = False,
    engine: Annotated[
        str, choice("--engine", known=ENGINES, help="plants run here, or as jobs of a cluster", default=ENGINES[0])
    ] = ENGINES[0],
    slurm_: Annotated[
        list[str] | None, typer.Option("--slurm", metavar="KEY=VALUE", help="of the jobs, e.g. partition=short")
    ] = None,
    status: Annotated[bool, typer.Option("--status", help="run nothing: print how the plants do")] = False,
    no_report: NoReport = False,
    set_: Set = None,
    as_json: AsJson = False,
    loud: Loud = None,
) -> None:
    """Measure every plant below a folder; batch.csv gets a row for each, failures first with their reasons."""
    from .. import slurm
    from ..batch import Batch, default_jobs, find_plants, require_named, saved_results
    from ..choices import Asked, choose
    from ..field.tables import TABLE
    from . import display, progress

    with report_errors(folder):
        plants, asked = find_plants(folder), Asked(preset, reset, parse_overrides(set_))
        require_named(plants, choose(None, asked, folder).options)  # refused once, not once a plant
        arguments = [*asked.arguments, *["--no-report"] * no_report]
        tell = progress.teller(loud)
        work = Batch(folder, arguments, jobs or default_jobs(), retry, tell, index=not no_report)
        if engine not in ENGINES:
            raise unknown(f"--engine {engine}", engine, ENGINES)
        if only_failed:
            work.results = saved_results(folder)
            failed = {result.folder for result in work.results.values() if result.state == State.FAILED}
            plants = [plant for plant in plants if plant.relative_to(folder).as_posix() in failed]
        if status:
            results = slurm.status(work, plants, asked)
            display.print_batch_status(results, as_json=as_json)
        elif engine == "slurm":
            executor = slurm.slurm_executor(folder, slurm_ or [])
            submitted = slurm.submit(work, plants, executor, slurm.max_array_size())
            typer.echo(f"{len(submitted)} plants submitted; `cotton3dg batch {folder} --status` tells how they do")
            return
        else:
            results = work.run(plants)
            display.print_batch(results, folder / TABLE, as_json=as_json)
    if any(result.state != State.DONE for result in results):
        raise typer.Exit(SOME_FAILED)


def status(
    plant_dir: PlantDir,
    preset: Preset = None,
    reset: Reset = False,
    as_json: AsJson = False,
    set_: Set = None,
) -> None:
    """Say what is done, what is stale and why, with seconds and memory of each stage."""
    from .. import pipeline
    from ..choices import Asked, plant_and_options
    from . import display, progress

    with report_errors(plant_dir):
        workspace, chosen = plant_and_options(plant_dir, Asked(preset, reset, parse_overrides(set_)))
        states = pipeline.status(workspace, chosen.options)
        display.tell_options(chosen, progress.teller(None))
        display.print_status(states, chosen, as_json=as_json)


def check(
    film: Annotated[Path, given(help="video, or folder of one plant")],
    preset: Preset = None,
    reset: Reset = False,
    as_json: AsJson = False,
    set_: Set = None,
    loud: Loud = None,
) -> None:
    """Judge a film in half a minute: green, yellow (exit code 9) or red (4); run goes on from it."""
    from ..choices import Asked, plant_and_options
    from ..commands.check import check as look
    from ..errors import DOUBTFUL, CaptureFailed
    from ..schemas.check import GREEN, RED
    from . import display, progress

    with report_errors(film):
        workspace, chosen = plant_and_options(film, Asked(preset, reset, parse_overrides(set_)), make=True)
        display.tell_options(chosen, progress.teller(loud), ("frames", "sfm"))
        with progress.ProgressDisplay(loud) as watcher:
            info = look(workspace, chosen.options, watcher, chosen.to_keep(("frames",)))
        if as_json:
            display.print_json(asdict(info))
        else:
            display.print_check(info, chosen.options["traits"].plant_id, workspace.check_html)
    if info.verdict != GREEN:
        raise typer.Exit(CaptureFailed.exit_code if info.verdict == RED else DOUBTFUL)


def clean(plant_dir: PlantDir) -> None:
    """Remove the images of a finished plant and what killed runs left; keep results and records."""
    from ..commands.clean import clean as drop
    from ..plants import plant_at

    with report_errors(plant_dir):
        dropped = drop(plant_at(plant_dir))
        rest = "" if dropped.finished else "; the plant is not finished, so its images stay"
        typer.echo(f"{dropped.n_files} files dropped, {dropped.n_bytes / 2**20:.1f} MiB free{rest}")


def report(plant_dir: PlantDir) -> None:
    """Make report.html: traits, photos, 3D view, walk and advice in one file; run makes it, too."""
    from ..plants import plant_at
    from ..report.page import is_stale, make_report

    with report_errors(plant_dir):
        workspace = plant_at(plant_dir)
        with workspace.locked():
            page = workspace.report_html
            typer.echo(f"saved as {make_report(workspace)}" if is_stale(workspace) else f"{page} is up to date")


def stage_command(stage: str) -> Callable[..., None]:
    """A command that runs one stage."""

    def command(plant_dir: Path, preset: str | None, reset: bool, force: bool, loud: bool | None, **flags: Any) -> None:
        from .. import pipeline
        from ..choices import Asked, plant_and_options
        from . import display, progress

        with report_errors(plant_dir):
            asked, stages = Asked(preset, reset, {stage: keep_given(flags)}), (stage,)
            workspace, chosen = plant_and_options(plant_dir, asked, make=stage == STAGES[0])
            display.tell_options(chosen, progress.teller(loud), stages)
            with progress.ProgressDisplay(loud) as watcher:
                pipeline.run(
                    workspace, chosen.options, stages, force=force, watcher=watcher, choices=chosen.to_keep(stages)
                )

    return add_flags(
        command,
        STAGE_OPTIONS[stage],
        plant_dir=PlantDir,
        preset=(Preset, None),
        reset=(Reset, False),
        force=(Force, False),
        loud=(Loud, None),
    )


def render(plant_dir: Path, loud: bool | None, **flags: Any) -> None:
    from .. import options
    from ..commands.render import render as make_film
    from ..plants import plant_at
    from . import display, progress

    with report_errors(plant_dir):
        workspace, chosen = plant_at(plant_dir), options.resolve("render", keep_given(flags))
        with progress.ProgressDisplay(loud) as watcher:
            record = make_film(workspace, chosen, watcher.watched("render"))
        display.print_render(record, workspace.root)


def masks_train(folder: Path, loud: bool | None, **flags: Any) -> None:
    from .. import options
    from ..commands.masks_train import train
    from . import progress

    with report_errors(folder):
        chosen = options.resolve("masks-train", keep_given(flags))
        with progress.ProgressDisplay(loud) as watcher:
            saved = train(folder, chosen, watcher.watched("masks-train"))
        typer.echo(f"saved as {saved}")


# `masks PLANT_DIR` takes a folder, so a sub-command of it could not be distinguished from a folder of that name.
def masks_export(plant_dir: PlantDir) -> None:
    """Save the plant's masks with their images as a COCO folder, for annotation tools and masks-train."""
    from ..commands.masks_export import export
    from ..plants import plant_at

    with report_errors(plant_dir):
        typer.echo(f"saved as {export(plant_at(plant_dir))}")
