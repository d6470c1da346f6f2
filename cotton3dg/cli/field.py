# SPDX-License-Identifier: Apache-2.0
"""Commands on many plants besides `batch`, and what is printed for a field; parse, call, print, no logic."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from ..command_options import FORMATS, HOW
from ..errors import SOME_FAILED, BadUsage
from .arguments import AsJson, Loud, PlantDir, choice, given, keep_given, report_errors


def cards(files: list[Path], **flags: Any) -> None:
    from .. import options
    from ..commands.cards import print_cards

    with report_errors(files[-1]):
        if len(files) > 2:
            raise BadUsage(f"{len(files)} files; give the field book, if any, and the cards to write (.pdf)")
        fieldbook = files[0] if len(files) > 1 else None
        typer.echo(print_cards(fieldbook, files[-1], options.resolve("cards", keep_given(flags))))


def markers(file: Path, **flags: Any) -> None:
    from .. import options
    from ..commands.markers import print_markers

    with report_errors(file):
        typer.echo(print_markers(file, options.resolve("markers", keep_given(flags))))


def import_(
    videos: Annotated[list[Path], given(help="videos, or folders that hold them, as a phone's DCIM")],
    into: Annotated[Path, typer.Option(help="folder of the field; made if needed")],
    fieldbook: Annotated[Path | None, typer.Option(help="table with a row for each plant (.csv, .xlsx)")] = None,
    id_column: Annotated[str, typer.Option(help="its column with the ids; default: plant_id and the like")] = "",
    names: Annotated[Path | None, typer.Option(help="table with the columns file and plant_id, by hand")] = None,
    how: Annotated[str, choice("--how", known=HOW, help="how the videos get there", default=HOW[0])] = HOW[0],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="change nothing: only say what would happen")] = False,
    as_json: AsJson = False,
    loud: Loud = None,
) -> None:
    """Sort videos that show a plant's card into a folder for each plant; report what is in doubt."""
    from ..commands.import_ import DOUBT, Import, import_videos
    from . import display, progress

    with report_errors(into):
        asked = Import(into, fieldbook, id_column, names, how, dry_run)
        with progress.ProgressDisplay(loud) as watcher:
            rows = import_videos(videos, asked, watcher.watched("import"))
        display.print_import(rows, into, dry_run=dry_run, as_json=as_json)
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
    as_json: AsJson = False,
    loud: Loud = None,
) -> None:
    """Correct bolls and the scale, for good: corrections.json keeps each correction, and every run applies them."""
    from ..commands.correct import Asked
    from ..commands.correct import correct as mend
    from ..plants import plant_at
    from . import display, progress

    with report_errors(plant_dir):
        picked = (add or (), corner or (), ruler or ())
        asked = Asked(file, merge or (), split or (), delete or (), branch or (), *picked, undo)
        with progress.ProgressDisplay(loud) as watcher:
            outcome = mend(plant_at(plant_dir), asked, watcher)
        display.print_corrections(outcome, as_json=as_json)
    if outcome.refused:
        raise typer.Exit(SOME_FAILED)


def view(
    folder: Annotated[Path, given(help="folder of one plant, or of a field; an empty one is a new field")],
    port: Annotated[int, typer.Option(min=0, max=65535, help="of 127.0.0.1; 0 = any that is free")] = 0,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="only print the address")] = False,
) -> None:
    """Open a plant or a field in the browser: correct bolls, watch runs, add films and measure them."""
    from ..batch import save_tables
    from ..commands.view import view as serve

    with report_errors(folder):
        serve(folder, save_tables, typer.echo, port=port, browser=not no_browser)


def export(
    folder: Annotated[Path, given(help="field that `batch` has run")],
    format_: Annotated[str, choice("--format", known=FORMATS, help="of the files", default="xlsx")] = "xlsx",
    out: Annotated[Path | None, typer.Option(help="folder for the files; default: export/FORMAT in the field")] = None,
) -> None:
    """Save a field's tables for breeding databases and spreadsheets."""
    from ..batch import save_tables
    from ..commands.export import export as write
    from ..field.tables import TABLE

    with report_errors(folder):
        if (folder / TABLE).is_file():  # any other folder stays as it is
            save_tables(folder)
        typer.echo(write(folder, format_, out))


FilmsOut = Annotated[Path, typer.Option(help="folder for tables and pictures")]
Reach = Annotated[float, typer.Option(help="how far a boll may have moved and still be the same, cm", min=0.1)]
TurnDeg = Annotated[
    float | None,
    typer.Option(help="how far the plant was turned between the films, degrees, where it is known; default: found"),
]


def compare(
    films: Annotated[list[Path], given(help="folders of one finished plant, filmed at several dates")],
    out: FilmsOut = Path("comparison"),
    reach_cm: Reach = 3.0,
    turn_deg: TurnDeg = None,
) -> None:
    """Compare films of one plant: each boll and each trait of the others against the first."""
    from ..evaluation.change_detection import compare as lay_beside
    from ..evaluation.change_detection import comparison_text
    from ..evaluation.change_detection_page import write_comparisons
    from ..evaluation.measured_plant import find_same_films
    from ..outputs import made_of, saving

    with report_errors(films[0]):
        comparisons = lay_beside(films, reach_cm, turn_deg)
        for remark in find_same_films([comparisons[0].first, *(each.other for each in comparisons)]):
            typer.echo(remark, err=True)
        with saving(out, made_of("compare", *films)) as folder:
            write_comparisons(folder, comparisons)
        for comparison in comparisons:
            typer.echo(comparison_text(comparison))
        typer.echo(f"saved in {out}")


def repeat(
    films: Annotated[list[Path], given(help="folders of a plant filmed several times, or of such fields")],
    out: FilmsOut = Path("repeat"),
    reach_cm: Reach = 3.0,
    turn_deg: TurnDeg = None,
) -> None:
    """Measure how far films of unchanged plants agree: scatter of each trait and of single bolls, and bias."""
    from ..evaluation.measured_plant import find_same_films
    from ..evaluation.repeatability import repeat as lay_beside
    from ..evaluation.repeatability import repeats_text
    from ..evaluation.repeatability_page import write_repeats
    from ..outputs import made_of, saving

    with report_errors(films[0]):
        repeats = lay_beside(films, reach_cm, turn_deg)
        for remark in (remark for plant in repeats.plants for remark in find_same_films(plant.films)):
            typer.echo(remark, err=True)
        with saving(out, made_of("repeat", *films)) as folder:
            write_repeats(folder, repeats)
        typer.echo(f"{repeats_text(repeats)}\nsaved in {out}")
