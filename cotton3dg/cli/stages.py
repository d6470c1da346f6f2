"""Commands on one plant: the run, its stages one by one, and what is made of them; parse, call, print, no logic."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..core.runs import State
from ..errors import SOME_FAILED, BadUsage, unknown
from ..options import STAGE_OPTIONS
from .arguments import (
    Force,
    NoReport,
    PlantDir,
    Preset,
    Reset,
    Set,
    TimeBudget,
    add_flags,
    given,
    keep_given,
    parse_overrides,
    report_errors,
)

if TYPE_CHECKING:
    from ..choices import Asked
    from ..planning.time_budget import Budget
    from ..workspace import Workspace


def run(
    plant_dir: PlantDir,
    from_: Annotated[str, typer.Option("--from", metavar="STAGE", help="first stage")] = next(iter(STAGE_OPTIONS)),
    until: Annotated[str, typer.Option(metavar="STAGE", help="last stage")] = list(STAGE_OPTIONS)[-1],
    preset: Preset = None,
    reset: Reset = False,
    force: Force = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="only say what would run, and why")] = False,
    wait: Annotated[bool, typer.Option("--wait", help="for another run of this plant, instead of failing")] = False,
    time_budget: TimeBudget = None,
    no_report: NoReport = False,
    repeat: Annotated[int, typer.Option(min=0, help="more runs, of other frames, to see how far they agree")] = 0,
    set_: Set = None,
) -> None:
    """From the video to traits.csv; only what is stale is made again."""
    from .. import pipeline
    from ..choices import Asked, plant_and_options
    from ..stage import STAGES
    from . import display

    with report_errors(plant_dir):
        asked, stages = Asked(preset, reset, parse_overrides(set_)), pipeline.selected(from_, until)
        if repeat and stages != STAGES:
            raise BadUsage("--repeat is for whole runs; leave out --from and --until")
        if time_budget and (preset or stages != STAGES):
            raise BadUsage("--time-budget chooses for the whole run; leave out --preset, --from and --until")
        workspace, chosen = plant_and_options(plant_dir, asked, make=stages[0] == STAGES[0] and not dry_run)
        budget = _budget(workspace, time_budget, asked) if time_budget else None
        chosen = budget.chosen if budget else chosen
        display.print_options(chosen, stages)
        if dry_run:
            pipeline.require_inputs(workspace, chosen.options, stages)
            display.print_plan(pipeline.plan(workspace, chosen.options, stages, force=force))
            return
        with display.ProgressDisplay() as watcher:
            how: dict[str, Any] = {"force": force, "wait": wait, "watcher": watcher, "report": not no_report}
            if budget:
                budget.run(**how)
            else:
                pipeline.run(workspace, chosen.options, stages, choices=chosen.to_keep(stages), **how)
        if "traits" in stages:
            display.print_traits(workspace)
        if repeat:
            from ..commands.run import repeat_runs
            from ..evaluation.repeatability import repeats_text

            with display.ProgressDisplay() as watcher:
                repeats = repeat_runs(workspace, chosen.options, repeat, partial(typer.echo, err=True), watcher)
            typer.echo(f"{repeats_text(repeats)}\nsaved in {workspace.repeats}")


def _budget(workspace: Workspace, time: str, asked: Asked) -> Budget:
    from ..planning.calibrate import read_or_calibrate
    from ..planning.time_budget import Budget
    from ..planning.tradeoff import parse_duration

    tell = partial(typer.echo, err=True)
    return Budget(workspace, parse_duration(time), read_or_calibrate(tell), asked, tell)


def batch(
    folder: Annotated[Path, given(help="folder with a folder for each plant")],
    jobs: Annotated[int, typer.Option(help="plants side by side; 0 = as many as cores and memory allow")] = 0,
    preset: Preset = None,
    reset: Reset = False,
    retry: Annotated[int, typer.Option(help="more tries for plants that a fault of the machine stopped")] = 0,
    only_failed: Annotated[bool, typer.Option("--only-failed", help="those that batch.csv calls failed")] = False,
    engine: Annotated[str, typer.Option(help="local: processes here | slurm: jobs of a cluster")] = "local",
    slurm_: Annotated[
        list[str] | None, typer.Option("--slurm", metavar="KEY=VALUE", help="of the jobs, e.g. partition=short")
    ] = None,
    status: Annotated[bool, typer.Option("--status", help="run nothing: save and print how the plants do")] = False,
    no_report: NoReport = False,
    set_: Set = None,
) -> None:
    """Every plant below a folder: batch.csv has a row for each, failures first with their reasons."""
    from .. import slurm
    from ..batch import Batch, default_jobs, find_plants, require_named, saved_results
    from ..choices import Asked, choose
    from ..field.tables import TABLE
    from . import display

    with report_errors(folder):
        plants, asked = find_plants(folder), Asked(preset, reset, parse_overrides(set_))
        require_named(plants, choose(None, asked, folder).options)  # refused once, not once a plant
        arguments = [*asked.arguments, *["--no-report"] * no_report]
        tell = partial(typer.echo, err=True)
        work = Batch(folder, arguments, jobs or default_jobs(), retry, tell, index=not no_report)
        if engine not in ("local", "slurm"):
            raise unknown(f"--engine {engine}", engine, ("local", "slurm"))
        if only_failed:
            work.results = saved_results(folder)
            failed = {result.folder for result in work.results.values() if result.state == State.FAILED}
            plants = [plant for plant in plants if plant.relative_to(folder).as_posix() in failed]
        if status:
            results = slurm.status(work, plants, asked)
        elif engine == "slurm":
            executor = slurm.slurm_executor(folder, slurm_ or [])
            submitted = slurm.submit(work, plants, executor, slurm.max_array_size())
            typer.echo(f"{len(submitted)} plants submitted; `cotton3dg batch {folder} --status` tells how they do")
            return
        else:
            results = work.run(plants)
        display.print_batch(results, folder / TABLE)
    if any(result.state != State.DONE for result in results):
        raise typer.Exit(SOME_FAILED)


def status(
    plant_dir: PlantDir,
    preset: Preset = None,
    reset: Reset = False,
    as_json: Annotated[bool, typer.Option("--json", help="for programs")] = False,
    set_: Set = None,
) -> None:
    """What is done, what is stale and why, with seconds and memory of each stage."""
    from .. import pipeline
    from ..choices import Asked, plant_and_options
    from . import display

    with report_errors(plant_dir):
        workspace, chosen = plant_and_options(plant_dir, Asked(preset, reset, parse_overrides(set_)))
        states = pipeline.status(workspace, chosen.options)
        display.print_options(chosen)
        if as_json:
            typer.echo(json.dumps(display.status_entries(states, chosen), indent=1))
        else:
            display.print_status(states, chosen)


def check(
    film: Annotated[Path, given(help="video, or folder of one plant")],
    preset: Preset = None,
    reset: Reset = False,
    as_json: Annotated[bool, typer.Option("--json", help="for programs")] = False,
    set_: Set = None,
) -> None:
    """Will this film do? Green, yellow (exit code 9) or red (4), in half a minute; run goes on from it."""
    from dataclasses import asdict

    from ..choices import Asked, plant_and_options
    from ..commands.check import check as look
    from ..errors import DOUBTFUL, CaptureFailed
    from ..schemas.check import GREEN, RED
    from . import display

    with report_errors(film):
        workspace, chosen = plant_and_options(film, Asked(preset, reset, parse_overrides(set_)), make=True)
        display.print_options(chosen, ("frames", "sfm"))
        with display.ProgressDisplay() as watcher:
            info = look(workspace, chosen.options, watcher, chosen.to_keep(("frames",)))
        if as_json:
            typer.echo(json.dumps(asdict(info), indent=1))
        else:
            display.print_check(info, workspace.plant_id, workspace.check_html)
    if info.verdict != GREEN:
        raise typer.Exit(CaptureFailed.exit_code if info.verdict == RED else DOUBTFUL)


def clean(plant_dir: PlantDir) -> None:
    """Free the images of a finished plant and what killed runs left; results and records stay, run makes it again."""
    from ..commands.clean import clean as drop
    from ..plants import plant_at

    with report_errors(plant_dir):
        dropped = drop(plant_at(plant_dir))
        rest = "" if dropped.finished else "; the plant is not finished, so its images stay"
        typer.echo(f"{dropped.n_files} files dropped, {dropped.n_bytes / 2**20:.1f} MiB free{rest}")


def report(plant_dir: PlantDir) -> None:
    """report.html: traits, photos, 3D view, walk and advice in one file; run makes it, too."""
    from ..plants import plant_at
    from ..report.page import is_stale, make_report

    with report_errors(plant_dir):
        workspace = plant_at(plant_dir)
        with workspace.locked():
            page = workspace.report_html
            typer.echo(f"saved as {make_report(workspace)}" if is_stale(workspace) else f"{page} is up to date")


def stage_command(stage: str) -> Callable[..., None]:
    """A command that runs one stage."""

    def command(plant_dir: Path, preset: str | None, reset: bool, force: bool, **flags: Any) -> None:
        from .. import pipeline
        from ..choices import Asked, plant_and_options
        from ..stage import STAGES
        from . import display

        with report_errors(plant_dir):
            asked, stages = Asked(preset, reset, {stage: keep_given(flags)}), (stage,)
            workspace, chosen = plant_and_options(plant_dir, asked, make=stage == STAGES[0])
            display.print_options(chosen, stages)
            with display.ProgressDisplay() as watcher:
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
    )


def render(plant_dir: Path, **flags: Any) -> None:
    from .. import options
    from ..commands.render import render as make_film
    from ..plants import plant_at
    from . import display

    with report_errors(plant_dir):
        workspace, chosen = plant_at(plant_dir), options.resolve("render", keep_given(flags))
        with display.ProgressDisplay() as watcher:
            record = make_film(workspace, chosen, watcher.watched("render"))
        display.print_render(record, workspace.root)


def masks_train(folder: Path, **flags: Any) -> None:
    from .. import options
    from ..commands.masks_train import train
    from . import display

    with report_errors(folder):
        chosen = options.resolve("masks-train", keep_given(flags))
        with display.ProgressDisplay() as watcher:
            typer.echo(f"saved as {train(folder, chosen, watcher.watched('masks-train'))}")


# `masks PLANT_DIR` takes a folder, so a sub-command of it could not be distinguished from a folder of that name.
def masks_export(plant_dir: PlantDir) -> None:
    """The plant's masks with their images as a COCO folder, for annotation tools and masks-train."""
    from ..commands.masks_export import export
    from ..plants import plant_at

    with report_errors(plant_dir):
        typer.echo(f"saved as {export(plant_at(plant_dir))}")
