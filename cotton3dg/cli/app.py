"""The command line: its commands under their names, in the order of the help."""

from __future__ import annotations

from typing import Annotated

import typer

from ..command_options import (
    CardsOptions,
    MarkersOptions,
    MasksTrainOptions,
    RenderOptions,
    SimulateOptions,
)
from ..options import STAGE_OPTIONS
from ..process import exit_cleanly
from . import accuracy, field, install, stages
from .arguments import CardFiles, ModelDir, NewFile, NewFolder, PlantDir, add_flags

app = typer.Typer(
    help="Cotton plant traits from a smartphone video: boll count, boll volume, plant height, canopy size.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Entry point of the console script."""
    with exit_cleanly():
        app()


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="print the version")] = False) -> None:
    if version:
        from ..core.version import version_text

        typer.echo(f"cotton3dg {version_text()}")
        raise typer.Exit


app.command("run", rich_help_panel="Everything")(stages.run)
app.command("batch", rich_help_panel="Everything")(stages.batch)
app.command("status", rich_help_panel="Everything")(stages.status)
app.command("check", rich_help_panel="Everything")(stages.check)
app.command("clean", rich_help_panel="Everything")(stages.clean)
app.command("report", rich_help_panel="Everything")(stages.report)
# `masks PLANT_DIR` takes a folder, so typer would take a sub-command of it for a folder of that name.
app.command("masks-export", rich_help_panel="Own masks")(stages.masks_export)
app.command("evaluate", rich_help_panel="Trying it out")(accuracy.evaluate)
app.command("evaluate-weights", rich_help_panel="Trying it out")(accuracy.evaluate_weights)
app.command("study", rich_help_panel="Trying it out")(accuracy.study)
for _stage in STAGE_OPTIONS:
    app.command(_stage, rich_help_panel="Single stages")(stages.stage_command(_stage))
app.command("render", rich_help_panel="Everything")(add_flags(stages.render, RenderOptions, plant_dir=PlantDir))
app.command("masks-train", rich_help_panel="Own masks")(
    add_flags(stages.masks_train, MasksTrainOptions, folder=ModelDir)
)
app.command("markers", rich_help_panel="Trying it out")(add_flags(field.markers, MarkersOptions, file=NewFile))
app.command("cards", rich_help_panel="Everything")(add_flags(field.cards, CardsOptions, files=CardFiles))
app.command("import", rich_help_panel="Everything")(field.import_)
app.command("correct", rich_help_panel="Everything")(field.correct)
app.command("view", rich_help_panel="Everything")(field.view)
app.command("export", rich_help_panel="Everything")(field.export)
app.command("compare", rich_help_panel="Everything")(field.compare)
app.command("repeat", rich_help_panel="Trying it out")(field.repeat)
app.command("demo", rich_help_panel="Trying it out")(install.demo)
app.command("doctor", rich_help_panel="Trying it out")(install.doctor)
app.command("bug-report", rich_help_panel="Trying it out")(install.bug_report)
app.command("simulate", rich_help_panel="Trying it out")(add_flags(install.simulate, SimulateOptions, folder=NewFolder))
