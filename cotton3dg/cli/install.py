"""Commands to try the program out: a simulated plant, does the installation work; parse, call, print, no logic."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from .arguments import OwnPreset, PlantDir, keep_given, report_errors


def simulate(folder: Path, **flags: Any) -> None:
    from .. import options
    from ..commands.simulate import simulate as film
    from . import display

    with report_errors(folder), display.ProgressDisplay() as watcher:
        film(folder, options.resolve("simulate", keep_given(flags)), watcher.watched("simulate"))


def demo(
    folder: Annotated[Path, typer.Argument(help="folder for the simulated plant; made if needed")] = Path("demo"),
    preset: OwnPreset = "draft",
) -> None:
    """A simulated plant from its film to its row, and that beside the truth: simulate, run, evaluate."""
    from .. import pipeline
    from ..choices import Asked, choose
    from ..command_options import SimulateOptions
    from ..commands.simulate import film_once
    from ..stage import STAGES
    from ..workspace import Workspace
    from . import display

    with report_errors(folder):
        with display.ProgressDisplay() as watcher:
            film_once(folder, SimulateOptions(), watcher.watched("simulate"))
            workspace = Workspace(folder)
            chosen = choose(workspace, Asked(preset))
            display.print_options(chosen)
            choices = chosen.to_keep(STAGES)
            pipeline.run(workspace, chosen.options, watcher=watcher, report=True, choices=choices)
        display.print_traits(workspace)
        display.print_comparison(workspace, workspace.truth_json)


def doctor(
    folder: Annotated[Path, typer.Argument(help="where plants are to be run")] = Path(),
    as_json: Annotated[bool, typer.Option("--json", help="for programs")] = False,
    calibrate: Annotated[bool, typer.Option("--calibrate", help="measure its speed, for --time-budget")] = False,
    fix: Annotated[bool, typer.Option("--fix", help="install what may be installed, and name the rest")] = False,
) -> None:
    """What this machine offers and lacks, with the commands that mend it; exit code 3 if it cannot be used."""
    from dataclasses import asdict

    from ..commands.doctor import conclude, examine, is_ready, mend
    from ..errors import EnvironmentUnusable
    from . import display

    with report_errors(folder):
        if calibrate:
            from ..planning.calibrate import calibrate as measure
            from ..planning.calibrate import describe

            typer.echo(describe(measure()), err=as_json)
        findings = examine(folder)
        if fix and any(finding.remedy for finding in findings):
            mend(findings, partial(typer.echo, err=True))
            findings = examine(folder)
        if as_json:
            typer.echo(json.dumps([asdict(finding) for finding in findings], indent=1))
        else:
            display.print_findings(findings)
            typer.echo(conclude(findings))
    if not is_ready(findings):
        raise typer.Exit(EnvironmentUnusable.exit_code)


def bug_report(
    plant_dir: PlantDir,
    out: Annotated[Path | None, typer.Option(help="file to write; default: bug_report_PLANT.zip here")] = None,
    images: Annotated[bool, typer.Option("--images", help="with the frames and the pictures of every stage")] = False,
) -> None:
    """What a developer needs to see of a failed plant, as one file: log, records, options, versions; no images."""
    from ..commands.bug_report import pack
    from ..commands.doctor import examine
    from ..plants import plant_at

    with report_errors(plant_dir):
        workspace = plant_at(plant_dir)
        machine = "".join(f"{item.name}: {item.found} {item.remedy}\n" for item in examine(plant_dir))
        file = pack(workspace, out or Path(f"bug_report_{workspace.plant_id}.zip"), machine, images=images)
        typer.echo(f"saved as {file}")
