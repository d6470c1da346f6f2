"""Commands about the installation itself: does it work, what does it lack; parse, call, print, no logic."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from .cli_arguments import Preset, report_errors


def demo(
    folder: Annotated[Path, typer.Argument(help="folder for the simulated plant; made if needed")] = Path("demo"),
    preset: Preset = "draft",
) -> None:
    """A simulated plant from its film to its row, and that beside the truth: simulate, run, evaluate."""
    from . import display, pipeline
    from .commands.simulate import film_once
    from .options import SimulateOptions
    from .workspace import Workspace

    with report_errors(folder):
        with display.ProgressDisplay() as watcher:
            film_once(folder, SimulateOptions(), watcher.watched("simulate"))
            workspace = Workspace(folder)
            pipeline.run(workspace, pipeline.stage_options(workspace, preset), pipeline.STAGES, watcher=watcher)
        display.print_traits(workspace.traits_csv)
        display.print_comparison(workspace, workspace.truth_json)


def doctor(
    folder: Annotated[Path, typer.Argument(help="where plants are to be run")] = Path(),
    as_json: Annotated[bool, typer.Option("--json", help="for programs")] = False,
    calibrate: Annotated[bool, typer.Option("--calibrate", help="measure its speed, for --time-budget")] = False,
) -> None:
    """What this machine offers and lacks, with the commands that mend it; exit code 3 if it cannot be used."""
    from dataclasses import asdict

    from . import display
    from .commands.doctor import examine
    from .errors import EnvironmentUnusable

    if calibrate:
        from .planning.calibrate import calibrate as measure
        from .planning.calibrate import describe

        with report_errors(folder):
            typer.echo(describe(measure()), err=as_json)
    findings = examine(folder)
    if as_json:
        typer.echo(json.dumps([asdict(finding) for finding in findings], indent=1))
    else:
        display.print_findings(findings)
    if any(finding.fatal and finding.remedy for finding in findings):
        raise typer.Exit(EnvironmentUnusable.exit_code)
