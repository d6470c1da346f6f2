# SPDX-License-Identifier: Apache-2.0
"""Cards to print, one for each plant of a field book, or numbered blank ones."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from ..command_options import CardsOptions
from ..core.card import DOTS_PER_CM, PAPER_CM
from ..errors import BadInput, BadUsage
from ..identity.codes import code_picture
from ..identity.draw_card import Picture, draw_card
from ..identity.fonts import unprintable
from ..identity.names import card_text, id_problem
from ..io.fieldbook import FieldBook, read_fieldbook
from ..io.sheet import pdf_of
from ..outputs import made_of, saving

LINES: Final = 6
MOST_NAMED: Final = 5


def print_cards(fieldbook: Path | None, sheet: Path, options: CardsOptions) -> str:
    """Write the cards, a page each; returns how they are used.

    Raises:
        BadUsage: another suffix than .pdf, neither a field book nor a number of blank cards, or both.
        BadInput: the field book cannot be read, or an id cannot be printed.
    """
    if sheet.suffix.lower() != ".pdf":
        how = "name the cards so" if fieldbook or options.blank else f"write cotton3dg cards {sheet.name} cards.pdf"
        raise BadUsage(f"{sheet.name} is not .pdf; {how}")
    if bool(fieldbook) == bool(options.blank):
        raise BadUsage("give a field book, or --blank NUMBER for cards without one")
    if fieldbook:
        cards = list(_cards_of(read_fieldbook(fieldbook, options.id_column), options.columns, fieldbook.name))
    else:
        cards = [(f"card-{number:04d}", []) for number in range(options.first, options.first + options.blank)]
    made = made_of("cards", fieldbook or f"--blank {options.blank} --first {options.first}")
    with saving(sheet.parent, made, instead="name") as folder:
        (folder / sheet.name).write_bytes(pdf_of(_drawn(cards, PAPER_CM[options.paper]), DOTS_PER_CM))
    return (
        f"{len(cards)} card{'s' * (len(cards) != 1)} saved as {sheet}\n{_warning(cards)}"
        "Print them at 100 %, measure a ruler of 10 cm. Lay a plant's card flat on the table with all of it in view; "
        "begin the video with the card.\n"
        "Then: cotton3dg import VIDEOS --into FIELD" + (f" --fieldbook {fieldbook}" if fieldbook else "")
    )


def _warning(cards: list[tuple[str, list[str]]]) -> str:
    """A line about the text that the cards cannot show; empty if they show all of it."""
    ids = unprintable(plant_id for plant_id, _ in cards)
    lines = unprintable(line for _, lines in cards for line in lines)
    if not ids and not lines:
        return ""
    shown, more = ", ".join((ids or lines)[:MOST_NAMED]), "" if len(ids or lines) <= MOST_NAMED else ", ..."
    kept = "; the codes are right" if ids else ""
    return (
        f"warning: no font of this machine has the letters of {shown}{more}, so boxes stand for them{kept}. Install a "
        "font, e.g. fonts-noto-cjk for Chinese or fonts-noto-core for Hindi, and print again\n"
    )


def _drawn(cards: list[tuple[str, list[str]]], paper_cm: tuple[float, float]) -> Iterator[Picture]:
    for plant_id, lines in cards:
        yield draw_card(code_picture(card_text(plant_id)), plant_id, lines, paper_cm, DOTS_PER_CM)


def _cards_of(book: FieldBook, columns: str, name: str) -> Iterator[tuple[str, list[str]]]:
    """Id and lines of each card."""
    wanted = [column.strip() for column in columns.split(",") if column.strip()] or list(book.columns[:LINES])
    if missing := [column for column in wanted if column not in book.columns]:
        raise BadUsage(f"{name} has no column {missing[0]!r}; it has {', '.join(book.columns)}")
    if len(wanted) > LINES:
        raise BadUsage(f"{len(wanted)} columns do not fit on a card; name at most {LINES} with --columns")
    for plant_id, row in book.rows.items():
        if problem := id_problem(plant_id):
            raise BadInput(f"{name}: {problem} ({plant_id[:20]!r}); change it there")
        yield plant_id, [f"{column}: {row[column]}" for column in wanted if row[column]]
