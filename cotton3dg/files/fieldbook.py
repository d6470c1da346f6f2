"""A lab's field book: a table with a row for each plant, as CSV of any spreadsheet or as .xlsx."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ..errors import BadInput, BadUsage

ID_COLUMNS: Final = (
    "plant_id", "unique_id", "observationunitname", "plot_name", "plot_id", "id", "plot", "plantid", "plotid",
)  # fmt: skip
"""Where the ids are looked for, in this order; spelling of capitals, spaces and hyphens does not matter."""
FIELD_BOOK: Final = "fieldbook.csv"
"""Of a field, in its folder."""
MOST_BYTES: Final = 50_000_000


@dataclass(frozen=True)
class FieldBook:
    """What the lab knows of its plants."""

    id_column: str
    columns: tuple[str, ...]
    """All others, in the table's order."""
    rows: dict[str, dict[str, str]]
    """Id -> column -> cell, in the table's order."""


def read_fieldbook(path: Path, id_column: str = "") -> FieldBook:
    """Read a field book: comma, semicolon or tab, UTF-8 or what Excel writes in Western Europe; or an Excel file.

    Args:
        id_column: the column that has the plants' ids; default: the first of `ID_COLUMNS` that there is.
    Raises:
        BadInput: no such file, not a table, or an id that two rows have.
        BadUsage: no column for the ids.
    """
    head, *body = _cells(path)
    names = [name.strip() for name in head]
    while names and not names[-1]:
        names.pop()
    if not all(names) or len(set(names)) < len(names):
        raise BadInput(f"{path.name}: a column has no name, or one that another has too; name each column once")
    id_column = _find_id_column(path, names, id_column)
    rows: dict[str, dict[str, str]] = {}
    lines: dict[str, int] = {}
    for line, cells in enumerate(body, 2):
        if any(cell.strip() for cell in cells[len(names) :]):
            raise BadInput(f"{path.name}, row {line}: more cells than columns; put text with commas in quotes")
        row = dict(zip(names, [cell.strip() for cell in cells] + [""] * len(names), strict=False))
        plant_id = row.pop(id_column)
        if not plant_id:
            if any(row.values()):
                raise BadInput(f"{path.name}, row {line}: no {id_column}; give each plant an id")
            continue
        if plant_id in rows:
            raise BadInput(f"{path.name}: {id_column} {plant_id} stands in rows {lines[plant_id]} and {line}")
        rows[plant_id], lines[plant_id] = row, line
    if not rows:
        raise BadInput(f"{path.name} has no rows; it needs a row for each plant")
    return FieldBook(id_column, tuple(name for name in names if name != id_column), rows)


def _find_id_column(path: Path, names: list[str], wanted: str) -> str:
    if wanted:
        if wanted not in names:
            raise BadUsage(f"{path.name} has no column {wanted!r}; it has {', '.join(names)}")
        return wanted
    plain = {plain_name(name): name for name in names}
    for candidate in ID_COLUMNS:
        if candidate in plain:
            return plain[candidate]
    raise BadUsage(f"{path.name} has no column plant_id; name the one with the ids: --id-column {names[0]!r}")


def plain_name(column: str) -> str:
    """A column's name as others may spell it."""
    return column.strip().lower().replace(" ", "_").replace("-", "_")


def _cells(path: Path) -> list[list[str]]:
    """All cells of a table, at least one row."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise BadInput(
                f"{path.name} is larger than {MOST_BYTES // 10**6} MB; give a table with a row for each plant"
            )
        cells = _excel_cells(path) if path.suffix.lower() in (".xlsx", ".xlsm") else _csv_cells(path.read_bytes())
    except (OSError, csv.Error) as error:
        raise BadInput(f"{path.name} cannot be read ({error}); save it as CSV in UTF-8") from error
    if not cells:
        raise BadInput(f"{path.name} is empty; it needs a row for each plant")
    return cells


def _csv_cells(content: bytes) -> list[list[str]]:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", "replace")
    head = text.split("\n", 1)[0]
    # Spreadsheets separate by what the country does not write decimals with; the header has no decimals.
    separator = max(",;\t", key=head.count)
    return [row for row in csv.reader(io.StringIO(text, newline=""), delimiter=separator) if row]


def _excel_cells(path: Path) -> list[list[str]]:
    """Of the first sheet, as they are shown: whole numbers without a point, dates as year-month-day."""
    import zipfile

    from openpyxl import load_workbook
    from openpyxl.utils.exceptions import InvalidFileException

    try:
        sheet = load_workbook(path, read_only=True, data_only=True).worksheets[0]
        rows = [[_shown(cell) for cell in row] for row in sheet.iter_rows(values_only=True)]
    except (InvalidFileException, zipfile.BadZipFile, KeyError, IndexError, ValueError) as error:
        raise BadInput(f"{path.name} is no Excel file that can be read ({error}); save it as CSV in UTF-8") from error
    return [row for row in rows if any(row)]


def _shown(cell: object) -> str:
    from datetime import date, datetime

    if cell is None:
        return ""
    if isinstance(cell, datetime) and not (cell.hour or cell.minute or cell.second):
        cell = cell.date()
    if isinstance(cell, date):
        return cell.isoformat()
    return f"{cell:g}" if isinstance(cell, float) and cell.is_integer() else str(cell)
