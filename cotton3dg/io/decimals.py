# SPDX-License-Identifier: Apache-2.0
"""Numbers as people of all countries write them: decimal dots and commas, thousands set off where that is certain."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Final

BLANKS: Final = frozenset({"", "na", "n/a", "nan", "none", "null", "-", "."})
"""Texts with which people, R and SAS mark a missing number; in lower case."""
GAP: Final = re.compile(r"(?<=\d)[ \u00a0\u2009\u202f'\u2019](?=\d{3}(?!\d))")
"""A separator between thousands that is neither a comma nor a dot."""
OTHER: Final = {".": ",", ",": "."}
"""Decimal mark -> the separator between thousands that goes with it."""
NUMBERS: Final = {
    mark: re.compile(
        rf"(?=[+-]?[.,]?\d)[+-]?(?:[1-9]\d{{0,2}}(?:[{other}]\d{{3}})+|\d*)(?:[{mark}]\d*)?(?:[eE][+-]?\d+)?", re.ASCII
    )
    for mark, other in OTHER.items()
}
"""Decimal mark -> pattern of a number with it, and perhaps with the other mark between thousands."""


def parse_decimal(cell: str, marks: set[str]) -> float:
    """The number in a cell; NaN if the cell is blank.

    Args:
        marks: the decimal marks of cells beside it (`decimal_marks`); with them 1,234 is a fraction, or is refused.
    Raises:
        ValueError: it is not a finite number, or may mean 1234 or 1.234; the message quotes it and names the remedy.
    """
    text = _plain(cell)
    if text.lower() in BLANKS:
        return math.nan
    readings = _readings(text)
    if len(set(readings.values())) > 1:
        own = "," if "," in text else "."
        if marks != {own}:
            either = " or ".join(f"{value:.15g}" for value in readings.values())
            raise ValueError(f"{text!r} may be {either}; write one of them")
        return readings[own]
    value = next(iter(readings.values()), math.nan)
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not a number; write a number alone, without its unit")
    return value


def with_dot(cell: str) -> str:
    """A number with a decimal comma in the form that other programs read; any other cell unchanged."""
    return cell.replace(".", "").replace(",", ".") if NUMBERS[","].fullmatch(cell) else cell


def decimal_marks(cells: Iterable[str]) -> set[str]:
    """The decimal marks of the cells that can be read with only one mark."""
    found = (_readings(_plain(cell)) for cell in cells)
    return {mark for readings in found if len(readings) == 1 for mark in readings}


def _plain(cell: str) -> str:
    return GAP.sub("", cell.strip().replace("\u2212", "-"))


def _readings(text: str) -> dict[str, float]:
    """Decimal mark -> the number that a text means with it."""
    return {
        mark: float(text.replace(OTHER[mark], "").replace(mark, "."))
        for mark, pattern in NUMBERS.items()
        if pattern.fullmatch(text)
    }
