# SPDX-License-Identifier: Apache-2.0
"""A field from the tables of its batch: rows with values, units and the field book's columns."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from ..core.columns import Column, columns_of
from ..core.measurements import PlantEvidence, PlantTraits
from ..errors import MissingInput
from ..io.tables import BOLLS, TRAITS, read_rows, value_of
from ..plants import refuse_plant
from .columns import find_roles
from .genotypes import FIT_COLUMNS, MEANS_COLUMNS

TABLE: Final = "batch.csv"
BOLL_TABLE: Final = "batch_bolls.csv"
MEANS_TABLE: Final = "genotypes.csv"
FITS_TABLE: Final = "heritability.csv"
BATCH_COLUMNS: Final = (
    Column("folder", "", "the plant's folder, relative to the batch's"),
    Column("state", "", "failed, waiting (not yet tried) or done"),
    Column("exit_code", "1", "of cotton3dg run; negative: the signal that ended it"),
    Column("reason", "", "why it failed and what to do"),
    *TRAITS,
)
"""Columns of batch.csv; the field book's columns follow."""
KNOWN: Final = {TABLE: BATCH_COLUMNS, BOLL_TABLE: BOLLS, MEANS_TABLE: MEANS_COLUMNS, FITS_TABLE: FIT_COLUMNS}
Sheets = dict[str, tuple[Sequence[str], list[list[Any]]]]
"""Name -> columns and rows."""
SPECIES: Final = {"hirsutum": 3635, "barbadense": 3634, "arboreum": 29729, "herbaceum": 34274}
"""Species of cultivated cotton -> number in NCBI's taxonomy; the first if the field book names none."""
DATE: Final = re.compile(r"\d{4}-\d\d-\d\d(T\d\d:\d\d(:\d\d)?(Z|[+-]\d\d:\d\d)?)?")


@dataclass(frozen=True)
class Table:
    """One table of a field."""

    columns: tuple[Column, ...]
    rows: list[dict[str, Any]]
    """By the columns' names; None = blank."""


@dataclass(frozen=True)
class Field:
    """All tables of a field."""

    name: str
    tables: Mapping[str, Table]
    """Tables by file name; always includes `batch.csv`."""

    @cached_property
    def plants(self) -> list[dict[str, Any]]:
        """Rows of the plants that have a result."""
        return [row for row in self.tables[TABLE].rows if row["plant_id"]]

    @cached_property
    def book_columns(self) -> tuple[str, ...]:
        """Columns that came from the field book."""
        known = {column.name for column in BATCH_COLUMNS}
        return tuple(column.name for column in self.tables[TABLE].columns if column.name not in known)

    @cached_property
    def roles(self) -> dict[str, str]:
        return find_roles(self.book_columns)

    def role(self, row: Mapping[str, Any], role: str) -> str:
        """The field book's cell of a plant for a role; empty if the book has none."""
        return str(row.get(self.roles.get(role, ""), "") or "")

    def species(self, row: Mapping[str, Any]) -> str:
        """Epithet of the plant's species, without the genus Gossypium."""
        return self.role(row, "species").removeprefix("Gossypium ").removeprefix("G. ") or next(iter(SPECIES))

    def date(self, row: Mapping[str, Any]) -> str:
        """The plant's date as year-month-day, with a time if there is one; empty if it is not a date."""
        date = self.role(row, "date").replace(" ", "T")
        return date if DATE.fullmatch(date) else ""


TRAIT_COLUMNS: Final[Sequence[Column]] = (
    *(column for column in columns_of(PlantTraits) if not column.name.startswith("original_")),
    *(column for column in columns_of(PlantEvidence) if column.name == "qc_flags"),
)
"""What is observed on a plant, with what makes it doubtful: corrections by a person, and flags. The other columns
describe how."""


def observed(row: Mapping[str, Any]) -> list[tuple[Column, Any]]:
    """Traits of a plant that have a value."""
    return [(column, row[column.name]) for column in TRAIT_COLUMNS if row.get(column.name) not in (None, "")]


def shown(column: Column, value: Any) -> str:
    """A value as the tables write it."""
    return f"{value:.{column.digits}f}" if column.digits is not None else str(value)


def read_field(folder: Path) -> Field:
    """Read what `cotton3dg batch` saved.

    Raises:
        MissingInput: `cotton3dg batch` has not run, or no plant has a result.
        BadInput: a table cannot be read.
    """
    tables = {}
    for name, known in KNOWN.items():
        if not (folder / name).is_file():
            if name == TABLE:
                if folder.is_dir():
                    refuse_plant(folder)
                raise MissingInput(f"{TABLE} is missing in {folder}; run `cotton3dg batch {folder}` first")
            continue
        rows = read_rows(folder / name)
        by_name = {column.name: column for column in known}
        heads = list(rows[0]) if rows else list(by_name)
        columns = tuple(by_name.get(head) or Column(head, "", "of the field book") for head in heads)
        tables[name] = Table(
            columns, [{column.name: value_of(row[column.name], column) for column in columns} for row in rows]
        )
    field = Field(folder.resolve().name, tables)
    if not field.plants:
        raise MissingInput(f"no plant of {folder} has a result; look at {TABLE} for the reasons")
    return field
