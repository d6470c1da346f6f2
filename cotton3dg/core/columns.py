# SPDX-License-Identifier: Apache-2.0
"""Columns of the tables, declared where the numbers are: as metadata of the fields of a dataclass."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, field, fields
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

    @property
    def scale_name(self) -> str:
        """Name of the unit in data exchange, where whole numbers without a unit are counts, and no unit means text."""
        return "count" if self.unit == "1" and self.digits is None else self.unit or "text"


def column(
    unit: str,
    description: str,
    digits: int | None = None,
    *,
    name: str = "",
    ontology: str = "",
    blank_when: str = "",
    leading: bool = False,
    default: Any = MISSING,
) -> Any:
    """A field of a dataclass that is a column.

    Args:
        unit: "1" of a number without a unit; empty of text, which `compare` and `repeat` leave out.
        name: name of the column; by default that of the field.
        leading: whether the column stands in front of all that do not lead, of whichever class.
        default: value of a field that is not given; by default it must be.
    """
    return columns({name: description}, unit, digits, ontology, blank_when, leading, default)


def columns(
    descriptions: dict[str, str],
    unit: str,
    digits: int | None = None,
    ontology: str = "",
    blank_when: str = "",
    leading: bool = False,
    default: Any = MISSING,
) -> Any:
    """A field whose items are a column each, by their names; the field may be None."""
    own = [Column(name, unit, text, digits, ontology, blank_when) for name, text in descriptions.items()]
    return field(default=default, metadata={"columns": own, "leading": leading})


def columns_of(*classes: type) -> tuple[Column, ...]:
    """The columns of some dataclasses, field by field; the leading ones first."""
    found: dict[bool, list[Column]] = {True: [], False: []}
    for item in (item for each in classes for item in fields(each)):
        for one in item.metadata.get("columns", ()):
            named = Column(**(vars(one) | {"name": one.name or item.name}))
            found[item.metadata["leading"]].append(named)
    return (*found[True], *found[False])


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
