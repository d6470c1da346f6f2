# SPDX-License-Identifier: Apache-2.0
"""Columns of a field book: what they mean, and how a table appends them to its own."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

from ..core.columns import Column
from ..io.fieldbook import FieldBook, plain_name

ROLES: Final = {
    "genotype": ("genotype", "germplasm", "germplasmname", "line", "accession", "variety", "cultivar", "entry",
                 "stock_name", "entry_name"),
    "block": ("block", "rep", "replicate", "replication", "blocknumber"),
    "treatment": ("treatment", "factor", "irrigation"),
    "plot": ("plot", "plot_id", "plot_number", "plotno", "plot_no"),
    "row": ("row", "field_row"),
    "column": ("column", "col", "range", "field_column"),
    "date": ("date", "filming_date", "phenotyping_date", "evaluation_date", "harvest_date"),
    "season": ("season", "year", "data_year"),
    "species": ("species", "taxon"),
    "site": ("site", "location", "site_name", "field", "studyname", "study"),
}  # fmt: skip
"""Role of a column in an experiment -> names that labs give it, the usual ones first."""
TAKEN_PREFIX: Final = "fieldbook_"
NUMBER: Final = re.compile(r"-\d+(\.\d+)?")


def find_roles(columns: Sequence[str]) -> dict[str, str]:
    """Role -> the column that plays it, for each role that a column plays."""
    plain = {plain_name(column): column for column in reversed(columns)}
    found = {}
    for role, names in ROLES.items():
        if column := next((plain[name] for name in names if name in plain), None):
            found[role] = column
    return found


def table_columns(book: FieldBook | None, taken: Collection[str]) -> dict[str, Column]:
    """Column of the field book -> the column that it becomes in a table which already has those `taken`."""
    found = {}
    for name in book.columns if book else ():
        own = f"{TAKEN_PREFIX}{name}" if name in taken else name
        found[name] = Column(own, "", "of the field book")
    return found


def book_cells(book: FieldBook | None, plant_id: str, columns: Mapping[str, Column]) -> dict[str, Any]:
    """The field book's cells of a plant, by the table's columns; blank if the book does not have the plant."""
    row = book.rows.get(plant_id, {}) if book else {}
    return {column.name: _value(row.get(name, "")) for name, column in columns.items()}


def _value(cell: str) -> Any:
    # A text that begins with a minus gets an apostrophe in front; a number needs none.
    return (float(cell) if "." in cell else int(cell)) if NUMBER.fullmatch(cell) else cell
