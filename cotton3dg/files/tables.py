"""CSV tables that a spreadsheet opens: RFC 4180, comma and dot, ASCII headers with units, blank where not measured."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ..core.columns import Column, columns_of
from ..core.measurements import BollTraits, PlantEvidence, PlantTraits

BYTE_ORDER_MARK = "\ufeff"


TRAITS = (
    Column("plant_id", "", "name of the plant: option traits.plant_id, else the folder's name"),
    *columns_of(PlantTraits, PlantEvidence),
)
"""Of traits.csv."""

BOLLS = (Column("plant_id", "", "name of the plant"), *columns_of(BollTraits))
"""Of bolls.csv."""

COLUMNS = (
    Column("table", "", "file that has the column"),
    Column("column", "", "header of the column"),
    Column("unit", "", "unit of its values"),
    Column("description", "", "what is measured and how"),
    Column("crop_ontology", "", "term of the Crop Ontology where one exists"),
)


def csv_text(columns: Sequence[Column], rows: Iterable[Mapping[str, Any]], *, excel: bool = False) -> str:
    """A table as text; write it in binary or with `newline=""`, its lines end in CR LF.

    NaN and None become blank cells; lists of flags are joined by semicolons. Text that a spreadsheet would take for a
    formula is prefixed with an apostrophe (CWE-1236); numbers never are.

    Args:
        excel: put a byte-order mark in front so that Excel reads UTF-8.
    Raises:
        KeyError: a row lacks a column.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\r\n")
    writer.writerow([column.name for column in columns])
    writer.writerows([[_cell(row[column.name], column.digits) for column in columns] for row in rows])
    return (BYTE_ORDER_MARK if excel else "") + text.getvalue()


def columns_text(tables: Mapping[str, Sequence[Column]], *, excel: bool = False) -> str:
    """`columns.csv`: a row for each column of each of `tables` (file name -> columns)."""
    rows = [
        {"table": table, "column": c.name, "unit": c.unit, "description": c.description, "crop_ontology": c.ontology}
        for table, columns in tables.items()
        for c in columns
    ]
    return csv_text(COLUMNS, rows, excel=excel)


def _cell(value: Any, digits: int | None) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return _harmless(value)
    if isinstance(value, (list, tuple)):
        return _harmless(";".join(str(item) for item in value))
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float):
        if not math.isfinite(value):
            return ""
        # Adding 0 turns -0.00 into 0.00.
        return f"{round(value, digits) + 0.0:.{digits}f}" if digits is not None else repr(value)
    return str(value)


def _harmless(text: str) -> str:
    """`text` as a spreadsheet shows it instead of computing it."""
    text = text.replace("\0", "")
    return "'" + text if text.lstrip().startswith(("=", "+", "-", "@")) or text[:1] in ("\t", "\r") else text
