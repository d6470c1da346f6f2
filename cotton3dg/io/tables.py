# SPDX-License-Identifier: Apache-2.0
"""CSV tables that a spreadsheet opens: RFC 4180, comma and dot, ASCII headers with units, blank where not measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ..core.columns import Column, columns_of
from ..core.map_measurements import BollMapTraits, BranchTraits, MapTraits
from ..core.measurements import BollColour, BollTraits, LintColour, PlantEvidence, PlantTraits
from ..errors import BadInput
from .decimals import with_dot
from .spreadsheet import defuse, read_table

if TYPE_CHECKING:
    from pandas import DataFrame

BYTE_ORDER_MARK: Final = "\ufeff"
LISTED: Final = "|"
"""Between the items of a list in a cell. No country's spreadsheet splits a table there, as many do at semicolons and
commas, or takes such a list for a number or a date."""
TELLING: Final = 3
"""Number of first columns that identify a table."""
COUNTING: Final = frozenset({"boll_id", "branch", "parent"})
"""Columns of whole numbers that name something, and so have no unit."""

TRAITS: Final = (
    Column("plant_id", "", "name of the plant: option traits.plant_id, else the folder's name"),
    *columns_of(PlantTraits, MapTraits, LintColour, PlantEvidence),
)
"""Columns of traits.csv: the four traits with their intervals and the flags, then the others by subject."""

BOLLS: Final = (Column("plant_id", "", "name of the plant"), *columns_of(BollTraits, BollMapTraits, BollColour))
"""Columns of bolls.csv."""

BRANCHES: Final = (Column("plant_id", "", "name of the plant"), *columns_of(BranchTraits))
"""Columns of branches.csv."""

COLUMNS: Final = (
    Column("table", "", "file that has the column"),
    Column("column", "", "header of the column"),
    Column("unit", "", "unit of its values"),
    Column("description", "", "what is measured and how"),
    Column("crop_ontology", "", "term of the Crop Ontology where one exists"),
)


def csv_text(columns: Sequence[Column], rows: Iterable[Mapping[str, Any]], *, excel: bool = False) -> str:
    """A table as text; write it in binary or with `newline=""`, its lines end in CR LF.

    NaN and None become blank cells; lists are joined (`joined`). Text that a spreadsheet would take for a
    formula is prefixed with an apostrophe (CWE-1236); numbers never are.

    Args:
        excel: put a byte-order mark in front so that Excel reads UTF-8.
    Raises:
        KeyError: a row lacks a column.
    """
    import pandas as pd

    # Cells are text already: each column has digits of its own, and pandas would write formulas unchanged.
    cells = [[_cell(row[column.name], column.digits) for column in columns] for row in rows]
    table = pd.DataFrame(cells, columns=[column.name for column in columns], dtype=object)
    text: str = table.to_csv(index=False, lineterminator="\r\n")
    return (BYTE_ORDER_MARK if excel else "") + text


def columns_text(tables: Mapping[str, Sequence[Column]], *, excel: bool = False) -> str:
    """`columns.csv`: a row for each column of each of `tables` (file name -> columns)."""
    rows = [
        {"table": table, "column": c.name, "unit": c.unit, "description": c.description, "crop_ontology": c.ontology}
        for table, columns in tables.items()
        for c in columns
    ]
    return csv_text(COLUMNS, rows, excel=excel)


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table of this program by the names of its columns, as text: "" for a blank cell.

    Numbers have dots also where a spreadsheet saved the table again with semicolons and decimal commas.

    Raises:
        BadInput: the file does not exist or is not a table (`read_table`).
    """
    table = read_table(path)
    if table.separator == ",":
        return table.rows
    return [{name: with_dot(cell) for name, cell in row.items()} for row in table.rows]


def frame_of(rows: Sequence[Mapping[str, str]], columns: Sequence[Column]) -> DataFrame:
    """Rows of a table, as `read_rows` gives them, as a pandas DataFrame.

    Ids and other text stay text, "" where blank; of numbers a blank is NaN. Columns that are not among `columns`, as
    those of a field book, become numbers if they hold nothing else.
    """
    import pandas as pd

    frame = pd.DataFrame(rows, columns=list(rows[0]) if rows else [column.name for column in columns])
    text = {column.name for column in columns if not is_number(column)}
    for name in frame.columns.difference(text):
        is_blank = frame[name] == ""
        numbers = pd.to_numeric(frame[name].mask(is_blank), errors="coerce")
        if (numbers.notna() | is_blank).all():
            frame[name] = numbers
    return frame


def refuse_other_table(path: Path, columns: Sequence[Column]) -> None:
    """Check that a table to be replaced is this tool's own: it begins with the same columns.

    Raises:
        BadInput: a table of that name is not this tool's own.
    """
    if not path.is_file() or not path.stat().st_size:
        return
    try:
        heads = read_table(path).columns
    except BadInput:
        heads = ()
    if heads[:TELLING] != tuple(column.name for column in columns[:TELLING]):
        raise BadInput(f"{path} stands where cotton3dg writes its table but was not made by it; move it elsewhere")


def joined(items: Iterable[Any]) -> str:
    """A list as the text of a cell."""
    return LISTED.join(map(str, items))


def flags_of(row: Mapping[str, Any]) -> list[str]:
    """Quality flags of a plant's or a boll's row; tables of earlier versions have semicolons between them."""
    return [flag for flag in str(row.get("qc_flags") or "").replace(";", LISTED).split(LISTED) if flag]


def parse_number(cell: Any) -> float:
    """A cell as a number; NaN if it is missing, blank or not a number."""
    try:
        return float(cell)
    except (TypeError, ValueError):
        return math.nan


def is_number(column: Column) -> bool:
    """Whether the cells of a column are numbers, else text."""
    return bool(column.unit) or column.name in COUNTING


def value_of(cell: str, column: Column) -> Any:
    """The value of a cell, which `csv_text` writes again unchanged.

    Raises:
        BadInput: a cell that should hold a number does not.
    """
    if not cell:
        return None
    if not is_number(column):
        return cell
    try:
        return float(cell) if column.digits is not None else int(cell)
    except ValueError as error:
        raise BadInput(
            f"column {column.name}: {cell!r} is not a number; take back what was changed there, or run again"
        ) from error


def _cell(value: Any, digits: int | None) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return defuse(value)
    if isinstance(value, (list, tuple)):
        return defuse(joined(value))
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float):
        if not math.isfinite(value):
            return ""
        # Adding 0 turns -0.00 into 0.00.
        return f"{round(value, digits) + 0.0:.{digits}f}" if digits is not None else repr(value)
    return str(value)
