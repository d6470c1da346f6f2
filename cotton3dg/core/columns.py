"""Columns of the tables, declared where the numbers are: as metadata of the fields of a dataclass."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, field, fields
from math import nan
from typing import Any


@dataclass(frozen=True)
class Column:
    """One column of a table, with its description in `columns.csv` and docs/csv.md."""

    name: str
    unit: str
    description: str
    digits: int | None = None
    """Digits after the dot; None for text and integers."""
    ontology: str = ""
    """Crop Ontology term."""
    blank_when: str = ""
    """Why a cell may be blank, by semicolons."""


def column(
    unit: str,
    description: str,
    digits: int | None = None,
    *,
    name: str = "",
    ontology: str = "",
    blank_when: str = "",
    later: bool = False,
    default: Any = MISSING,
) -> Any:
    """A field of a dataclass that is a column.

    Args:
        name: name of the column; by default that of the field.
        later: whether the column came after the first tables; it stands behind all their columns, so that these keep
            their places.
        default: NaN for a later column, else none.
    """
    default = nan if later and default is MISSING else default
    return columns({name: description}, unit, digits, ontology, blank_when, later, default)


def columns(
    descriptions: dict[str, str],
    unit: str,
    digits: int | None = None,
    ontology: str = "",
    blank_when: str = "",
    later: bool = False,
    default: Any = MISSING,
) -> Any:
    """A field whose items are a column each, by their names; the field may be None."""
    own = [Column(name, unit, text, digits, ontology, blank_when) for name, text in descriptions.items()]
    return field(default=default, metadata={"columns": own, "later": later})


def columns_of(*classes: type) -> tuple[Column, ...]:
    """The columns of some dataclasses, field by field; those that came later behind all others."""
    found: dict[bool, list[Column]] = {False: [], True: []}
    for item in (item for each in classes for item in fields(each)):
        for one in item.metadata.get("columns", ()):
            named = Column(**(vars(one) | {"name": one.name or item.name}))
            found[item.metadata["later"]].append(named)
    return (*found[False], *found[True])


def cells_of(*records: Any) -> dict[str, Any]:
    """The values of some instances of such classes, by column."""
    cells: dict[str, Any] = {}
    for record in records:
        for item in fields(record):
            own = item.metadata.get("columns", ())
            value = getattr(record, item.name) if own else None
            values = [value] if len(own) == 1 else [None] * len(own) if value is None else value
            cells |= {one.name or item.name: cell for one, cell in zip(own, values, strict=True)}
    return cells
