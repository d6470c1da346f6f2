# SPDX-License-Identifier: Apache-2.0
"""The command line: its commands under their names, grouped by what people do, in the order of the help."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Final

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
from .arguments import CardFiles, Command, Group, Loud, ModelDir, NewFile, NewFolder, PlantDir, add_flags

app = typer.Typer(
    cls=Group,
    help="Measure cotton plants from a smartphone video: boll count, boll volume, plant height, canopy size.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Entry point of the console script."""
    with exit_cleanly():
        app()


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", "-V", help="print the version")] = False) -> None:
    if version:
        from ..core.version import version_text

        typer.echo(f"cotton3dg {version_text()}")
        raise typer.Exit


EXAMPLES: Final = {
    "run": """\
Examples:
  cotton3dg run plant_017
  cotton3dg run plant_017 --preset draft
  cotton3dg run plant_017 --set scale.table_length_cm=100
  cotton3dg run plant_017 --from masks --force
  cotton3dg run plant_017 --time-budget 10m

Minutes for a film of half a minute on two cores:
  draft 1, standard 2, paper 72, paper1 6, paper2 74""",
}
"""Command -> what its help ends with."""

COMMANDS: Final[dict[str, dict[str, Callable[..., Any]]]] = {
    "Measure": {
        "run": stages.run,
        "batch": stages.batch,
        "status": stages.status,
        "check": stages.check,
        "clean": stages.clean,
    },
    "Field": {
        "cards": add_flags(field.cards, CardsOptions, files=CardFiles),
        "markers": add_flags(field.markers, MarkersOptions, file=NewFile),
        "import": field.import_,
        "export": field.export,
        "compare": field.compare,
    },
    "Look and correct": {
        "report": stages.report,
        "view": field.view,
        "correct": field.correct,
        "render": add_flags(stages.render, RenderOptions, plant_dir=PlantDir, loud=(Loud, None)),
    },
    "Your own masks": {
        "masks-export": stages.masks_export,
        "masks-train": add_flags(stages.masks_train, MasksTrainOptions, folder=ModelDir, loud=(Loud, None)),
    },
    "Accuracy": {
        "evaluate": accuracy.evaluate,
        "evaluate-weights": accuracy.evaluate_weights,
        "repeat": field.repeat,
        "study": accuracy.study,
        "simulate": add_flags(install.simulate, SimulateOptions, folder=NewFolder, loud=(Loud, None)),
    },
    "Installation": {"doctor": install.doctor, "demo": install.demo, "bug-report": install.bug_report},
    "Stages": {stage: stages.stage_command(stage) for stage in STAGE_OPTIONS},
}
"""Group of the help -> its commands."""

for _panel, _commands in COMMANDS.items():
    for _name, _command in _commands.items():
        app.command(_name, cls=Command, rich_help_panel=_panel, epilog=EXAMPLES.get(_name))(_command)
