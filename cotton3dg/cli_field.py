"""Commands on many plants besides `batch`: cards, import, corrections, exports; parse, call, print, no logic."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from .cli_arguments import PlantDir, keep_given, report_errors
from .errors import SOME_FAILED, BadUsage


def cards(files: list[Path], **flags: Any) -> None:
    from . import options
    from .commands.cards import print_cards

    with report_errors(files[-1]):
        if len(files) > 2:
            raise BadUsage(f"{len(files)} files; give the field book, if any, and the cards to write (.pdf)")
        fieldbook = files[0] if len(files) > 1 else None
        typer.echo(print_cards(fieldbook, files[-1], options.resolve("cards", keep_given(flags))))


def import_(
    videos: Annotated[list[Path], typer.Argument(help="videos, or folders that hold them, as a phone's DCIM")],
    into: Annotated[Path, typer.Option(help="folder of the field; made if needed")],
    fieldbook: Annotated[Path | None, typer.Option(help="table with a row for each plant (.csv, .xlsx)")] = None,
    id_column: Annotated[str, typer.Option(help="its column with the ids; default: plant_id and the like")] = "",
    names: Annotated[Path | None, typer.Option(help="table with the columns file and plant_id, by hand")] = None,
    how: Annotated[str, typer.Option(help="copy | move | link")] = "copy",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="change nothing: only say what would happen")] = False,
) -> None:
    """A folder for each plant from videos that show its card; what is in doubt is told and never guessed."""
    from . import display
    from .commands.import_videos import DOUBT, Import, import_videos

    with report_errors(into), display.ProgressDisplay() as watcher:
        asked = Import(into, fieldbook, id_column, names, how, dry_run)
        rows = import_videos(videos, asked, watcher.watched("import"))
        display.print_import(rows, into, dry_run=dry_run)
    if any(row.state == DOUBT for row in rows):
        raise typer.Exit(SOME_FAILED)


def correct(
    plant_dir: PlantDir,
    file: Annotated[Path | None, typer.Argument(help="corrections.json that the plant's report saved")] = None,
    merge: Annotated[list[str] | None, typer.Option(metavar="N,N", help="bolls that are one; repeatable")] = None,
    split: Annotated[list[int] | None, typer.Option(metavar="N", help="a boll that is two")] = None,
    delete: Annotated[list[int] | None, typer.Option(metavar="N", help="a boll that is none")] = None,
    branch: Annotated[list[int] | None, typer.Option(metavar="N", help="a boll that is a branch")] = None,
    add: Annotated[
        list[str] | None,
        typer.Option(metavar="PICKS", help="a boll at 'IMAGE:X,Y IMAGE:X,Y', px of undistorted images"),
    ] = None,
    corner: Annotated[
        list[str] | None, typer.Option(metavar="PICKS", help="where the nearest corner of the table is, the same way")
    ] = None,
    ruler: Annotated[
        list[str] | None, typer.Option(metavar="PICKS / PICKS", help="measure between two points; changes nothing")
    ] = None,
    undo: Annotated[bool, typer.Option("--undo", help="take the last correction back")] = False,
) -> None:
    """Mend bolls and the scale, for good: what is said is kept in corrections.json and applied by every run."""
    from . import display
    from .commands.correct import Asked
    from .commands.correct import correct as mend
    from .workspace import Workspace

    with report_errors(plant_dir), display.ProgressDisplay() as watcher:
        picked = (add or (), corner or (), ruler or ())
        asked = Asked(file, merge or (), split or (), delete or (), branch or (), *picked, undo)
        outcome = mend(Workspace(plant_dir), asked, watcher)
        display.print_corrections(outcome)
    if outcome.refused:
        raise typer.Exit(SOME_FAILED)


def export(
    folder: Annotated[Path, typer.Argument(help="field that `batch` has run")],
    format_: Annotated[
        str, typer.Option("--format", help="brapi | miappe | frictionless | cottongen | fieldbook | xlsx")
    ] = "xlsx",
    out: Annotated[Path | None, typer.Option(help="folder for the files; default: export/FORMAT in the field")] = None,
) -> None:
    """A field's tables for breeding databases and spreadsheets."""
    from .commands.export import export as write

    with report_errors(folder):
        typer.echo(write(folder, format_, out))
