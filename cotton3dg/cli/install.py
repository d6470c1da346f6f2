# SPDX-License-Identifier: Apache-2.0
"""Commands to try the program out: a simulated plant, does the installation work; parse, call, print, no logic."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from .arguments import AsJson, Loud, OwnPreset, PlantDir, keep_given, report_errors


def simulate(folder: Path, loud: bool | None, **flags: Any) -> None:
    from .. import options
    from ..commands.simulate import simulate as film
    from . import progress

    with report_errors(folder), progress.ProgressDisplay(loud) as watcher:
        film(folder, options.resolve("simulate", keep_given(flags)), watcher.watched("simulate"))


def demo(
    folder: Annotated[Path, typer.Argument(help="folder for the simulated plant; made if needed")] = Path("demo"),
    preset: OwnPreset = "draft",
    loud: Loud = None,
) -> None:
    """Simulate a plant, run it, and print its row beside the truth."""
    from .. import pipeline
    from ..choices import Asked, choose
    from ..command_options import SimulateOptions
    from ..commands.run import read_ending
    from ..commands.simulate import film_once
    from ..stage import STAGES
    from ..workspace import Workspace
    from . import display, progress

    with report_errors(folder):
        with progress.ProgressDisplay(loud) as watcher:
            film_once(folder, SimulateOptions(), watcher.watched("simulate"))
            workspace = Workspace(folder)
            chosen = choose(workspace, Asked(preset))
            display.tell_options(chosen, watcher.say)
            choices = chosen.to_keep(STAGES)
            pipeline.run(workspace, chosen.options, watcher=watcher, report=True, choices=choices)
        display.print_ending(read_ending(workspace))
        display.print_comparison(workspace, workspace.truth_json)


def doctor(
    folder: Annotated[Path, typer.Argument(help="where plants are to be run")] = Path(),
    as_json: AsJson = False,
    calibrate: Annotated[bool, typer.Option("--calibrate", help="measure its speed, for --time-budget")] = False,
    fix: Annotated[bool, typer.Option("--fix", help="install what may be installed, and name the rest")] = False,
) -> None:
    """Say what this machine offers and lacks, and what mends it; exit code 3 if it cannot be used."""
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
            display.print_json([asdict(finding) for finding in findings])
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
    """Pack what a developer needs to see of a failed plant: log, records, options, versions; no images."""
    from ..commands.bug_report import pack
    from ..commands.doctor import examine
    from ..plants import plant_at

    with report_errors(plant_dir):
        workspace = plant_at(plant_dir)
        machine = "".join(f"{item.name}: {item.found} {item.remedy}\n" for item in examine(plant_dir))
        file = pack(workspace, out or Path(f"bug_report_{workspace.plant_id}.zip"), machine, images=images)
        typer.echo(f"saved as {file}")
