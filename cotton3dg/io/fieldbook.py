# SPDX-License-Identifier: Apache-2.0
"""A lab's field book: a table with a row for each plant, as CSV of any spreadsheet or as .xlsx."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ..errors import BadInput, BadUsage
from .spreadsheet import read_table

ID_COLUMNS: Final = (
    "plant_id", "unique_id", "observationunitname", "plot_name", "plot_id", "id", "plot", "plantid", "plotid",
)  # fmt: skip
"""Columns that may hold the ids, in this order; capitals, spaces and hyphens do not matter."""
FIELD_BOOK: Final = "fieldbook.csv"
"""Name of the field book in a field's folder."""


@dataclass(frozen=True)
class FieldBook:
    """What the lab knows about its plants."""

    id_column: str
    columns: tuple[str, ...]
    """All other columns, in the table's order."""
    rows: dict[str, dict[str, str]]
    """Id -> column -> cell, in the table's order."""


def read_fieldbook(path: Path, id_column: str = "") -> FieldBook:
    """Read a field book, as CSV or as an Excel file (`read_table`).

    Args:
        id_column: the column that has the plants' ids; default: the first of `ID_COLUMNS` that the table has.
    Raises:
        BadInput: the file does not exist, is not a table, or has an id in two rows.
        BadUsage: the table has no column for the ids.
    """
    table = read_table(path)
    if not table.rows:
        raise BadInput(f"{path.name} has no rows; it needs a header and a row for each plant")
    id_column = _find_id_column(path, table.columns, id_column)
    rows: dict[str, dict[str, str]] = {}
    lines: dict[str, int] = {}
    for line, cells in zip(table.lines, table.rows, strict=True):
        row = {name: cell.strip() for name, cell in cells.items()}
        plant_id = row.pop(id_column)
        if not plant_id:
            raise BadInput(f"{path.name}, row {line}: no {id_column}; give each plant an id")
        if plant_id in rows:
            raise BadInput(f"{path.name}: {id_column} {plant_id} stands in rows {lines[plant_id]} and {line}")
        rows[plant_id], lines[plant_id] = row, line
    return FieldBook(id_column, tuple(name for name in table.columns if name != id_column), rows)


def _find_id_column(path: Path, names: Sequence[str], wanted: str) -> str:
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
    """A column's name with differences in spelling removed."""
    return column.strip().lower().replace(" ", "_").replace("-", "_")
