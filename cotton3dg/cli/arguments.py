# SPDX-License-Identifier: Apache-2.0
"""What the commands share: their arguments and flags, what Tab completes, and how they report errors."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from ..errors import INTERRUPTED, BadUsage, Cotton3dgError, unknown
from ..io.saving import explained
from ..option_rules import flags, places, retired_flags
from ..options import PRESETS, STAGE_OPTIONS, STANDARD

given = partial(typer.Argument, readable=False)
"""A file or folder; one that cannot be read is explained where it is read, and not with typer's page of help."""

PlantDir = Annotated[Path, given(help="folder of one plant, with its video or an images folder; or a video")]
ModelDir = Annotated[Path, typer.Argument(help="folder for the trained model; made if needed")]
CardFiles = Annotated[
    list[Path], typer.Argument(metavar="[FIELDBOOK] CARDS", help="field book (.csv, .xlsx), and the cards (.pdf)")
]
NewFile = Annotated[Path, typer.Argument(help="the sheet: a name that ends in .pdf or .png")]
NewFolder = Annotated[Path, typer.Argument(help="folder for the simulated plant; made if needed")]


def choice(*names: str, known: Iterable[str], help: str, default: str = "") -> Any:
    """An option whose help lists what is known, and Tab completes it; the command itself refuses other words, in a line
    that names the likeliest one.

    Args:
        default: the default in words.
    """
    known = tuple(known)
    notes = " | ".join(known) + (f"; default: {default}" if default else "")
    return typer.Option(*names, help=f"{help} ({notes})", show_default=False, **_completed(known))


def _completed(known: tuple[str, ...]) -> dict[str, Any]:
    """Settings of an option that Tab completes."""
    return {"metavar": "<choice>", "autocompletion": lambda: known} if known else {}


def _assignments() -> list[str]:
    """The words that may follow `--set`: an option, with each of its choices if it has some."""
    words = []
    for stage, kind in STAGE_OPTIONS.items():
        for place in places(kind):
            values = place.item.metadata["choices"] or (("true", "false") if place.kind is bool else ("",))
            words += [f"{stage}.{place.name}={value}" for value in values]
    return list(dict.fromkeys(words))


_COST: Final = "what accuracy may cost in time"
OwnPreset = Annotated[str, choice("--preset", known=PRESETS, help=_COST, default="draft")]
"""Of a command that works by a preset of its own, whatever a plant was run with."""
Preset = Annotated[
    str | None, choice("--preset", known=PRESETS, help=_COST, default=f"as the last run, else {STANDARD}")
]
Reset = Annotated[bool, typer.Option("--reset", help="leave the last run's options for the defaults")]
Force = Annotated[bool, typer.Option("--force", help="run even what is up to date")]
NoReport = Annotated[bool, typer.Option("--no-report", help="make no page to look at")]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="STAGE.OPTION=VALUE", help="any stage's option; repeatable", autocompletion=_assignments
    ),
]
TimeBudget = Annotated[str | None, typer.Option(metavar="TIME", help="time that it may take, e.g. 90s, 5m, 1h30m")]
AsJson = Annotated[bool, typer.Option("--json", help="print for programs")]
Loud = Annotated[
    bool | None,
    typer.Option("--verbose/--quiet", "-v/-q", show_default=False, help="say more while it works, or only the results"),
]
"""True with --verbose, False with --quiet, None with neither."""


class Command(TyperCommand):
    """A command whose help shows no type beside a flag, which takes no value."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _without_types_of_flags(super().get_params(ctx))


class Group(TyperGroup):
    """The same for the program itself."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _without_types_of_flags(super().get_params(ctx))


def _without_types_of_flags(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
    return parameters


@contextmanager
def report_errors(plant_dir: Path) -> Iterator[None]:
    """Print an error as one line that starts with the plant's name, and end with its exit code.

    What the operating system says of a path is explained here for all commands.
    """
    try:
        yield
    except Cotton3dgError as error:
        _end(plant_dir, str(error), error.exit_code, error)
    except BrokenPipeError:
        raise
    except OSError as error:
        explanation = explained(error, plant_dir)
        _end(plant_dir, str(explanation), explanation.exit_code, error)
    except KeyboardInterrupt as error:
        _end(plant_dir, "interrupted; the same command continues", INTERRUPTED, error)


def _end(plant_dir: Path, text: str, code: int, cause: BaseException) -> NoReturn:
    name = plant_dir.resolve().name
    # A message about the very path that was given names it already.
    line = text if text.startswith((name, str(plant_dir))) else f"{name}: {text}"
    typer.echo(" ".join(line.split()), err=True)
    raise typer.Exit(code) from cause


def parse_overrides(assignments: list[str] | None) -> dict[str, dict[str, Any]]:
    overrides: dict[str, dict[str, Any]] = {}
    for assignment in assignments or []:
        key, equals, value = assignment.partition("=")
        stage, dot, name = key.partition(".")
        if not (equals and dot):
            raise BadUsage(f"--set {assignment}: write STAGE.OPTION=VALUE, e.g. train.steps=3000")
        if stage not in STAGE_OPTIONS:
            raise unknown(f"--set {assignment}: stage {stage!r}", stage, STAGE_OPTIONS)
        overrides.setdefault(stage, {})[name] = value
    return overrides


def keep_given(flags: dict[str, Any]) -> dict[str, Any]:
    """The flags that the user gave; the others are None, so that TOML and presets apply."""
    return {name: value for name, value in flags.items() if value is not None}


def add_flags(command: Callable[..., None], options: type, **arguments: Any) -> Callable[..., None]:
    """`command` as typer sees it: `arguments` (annotation, or annotation and default), then a flag for each option."""
    position = inspect.Parameter.POSITIONAL_OR_KEYWORD
    parameters = []
    for name, annotation in arguments.items():
        kind, default = annotation if isinstance(annotation, tuple) else (annotation, inspect.Parameter.empty)
        parameters.append(inspect.Parameter(name, position, annotation=kind, default=default))
    for name, (place, help_text) in flags(options).items():
        flag = typer.Option(help=help_text, show_default=False, **_completed(place.item.metadata["choices"]))
        annotation = Annotated[place.kind | None, flag]
        parameters.append(inspect.Parameter(name, position, annotation=annotation, default=None))
    for name in retired_flags(options):
        parameters.append(
            inspect.Parameter(name, position, annotation=Annotated[str | None, typer.Option(hidden=True)], default=None)
        )
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    command.__doc__ = options.__doc__
    return command
