# SPDX-License-Identifier: Apache-2.0
"""Tables that a person made in a spreadsheet of any country: CSV with commas, semicolons or tabs, or an Excel file."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import BadInput
from ..text import decode_text
from .decimals import decimal_marks, parse_decimal
from .workbook import is_workbook, workbook_cells

MOST_BYTES: Final = 50_000_000
SEPARATORS: Final = "\t;,"
"""A header with commas in its names has as many semicolons or more; one of commas has no semicolons."""
TRIED_ROWS: Final = 20
"""Number of rows that show which separator divides them into as many cells as the header."""
SEPARATOR_LINE: Final = re.compile(r'"?sep=(.)"?\n', re.IGNORECASE)
"""The first line of a CSV file that is meant for Excel."""
FORMULA_ERRORS: Final = frozenset({"#N/A", "#REF!", "#VALUE!", "#DIV/0!", "#NAME?", "#NUM!", "#NULL!"})


@dataclass(frozen=True)
class Table:
    """Cells of a table as text."""

    name: str
    """Name of the file, for messages."""
    columns: tuple[str, ...]
    rows: list[dict[str, str]]
    """By the columns' names, "" for a blank cell; rows without any text are left out."""
    lines: tuple[int, ...]
    """Number of each row in the spreadsheet, where the header is 1."""
    separator: str
    """The separator of a CSV file's cells; "" for an Excel file."""

    def require(self, *columns: str) -> None:
        """Check that the table has these columns.

        Raises:
            BadInput: a column is missing.
        """
        if missing := [column for column in columns if column not in self.columns]:
            has = f"it has {', '.join(self.columns)}" if self.columns else "it is empty"
            raise BadInput(f"{self.name} has no column {', '.join(missing)} ({has}); name the columns in its first row")

    def numbers(self, column: str) -> NDArray[np.float64]:
        """(N,) numbers of a column with decimal dots or commas, NaN for a blank cell.

        Raises:
            BadInput: a cell is not a finite number, or could mean two numbers (`parse_decimal`).
        """
        cells = [row[column] for row in self.rows]
        marks = decimal_marks(cells)
        if not marks:
            marks = decimal_marks(cell for row in self.rows for cell in row.values())
            marks = marks if len(marks) == 1 else {"," if self.separator == ";" else "."}
        return np.array(
            [self._number(column, *item, marks) for item in zip(self.lines, cells, strict=True)], np.float64
        )

    def _number(self, column: str, line: int, cell: str, marks: set[str]) -> float:
        try:
            return parse_decimal(cell, marks)
        except ValueError as error:
            raise BadInput(f"{self.name}, row {line}, column {column}: {error}") from error


def read_table(path: Path) -> Table:
    """Read a table of any of these kinds; its content shows which it is.

    The header is the first row with text. A first column without a name that counts the rows, as R and pandas write
    it, is left out.

    Raises:
        BadInput: no file, not a table, neither UTF-8 nor UTF-16, a column without a name or with that of another,
            a row with more cells than the header, or the error of a formula.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise BadInput(f"{path.name} is larger than {MOST_BYTES // 10**6} MB; leave out what is not needed of it")
        content = path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path.name} cannot be read ({error.strerror}); look at its name and permissions") from error
    separator, cells = "", []
    if is_workbook(content) or path.suffix.lower() in (".xlsx", ".xlsm"):
        cells = workbook_cells(content, path.name)
    else:
        separator, cells = _csv_cells(decode_text(content, path.name), path.name)
    filled = [(line, row) for line, row in enumerate(cells, 1) if any(cell.strip() for cell in row)]
    for line, row in filled:
        if wrong := next((cell for cell in row if cell.strip() in FORMULA_ERRORS), None):
            raise BadInput(f"{path.name}, row {line}: a cell is the error {wrong.strip()}; mend its formula")
    body = filled[1:]
    columns = _columns(path.name, [cell.strip() for cell in filled[0][1]], body) if filled else {}
    rows = [{name: restore(_at(row, place)) for place, name in columns.items()} for _, row in body]
    return Table(path.name, tuple(columns.values()), rows, tuple(line for line, _ in body), separator)


def _columns(name: str, head: list[str], body: list[tuple[int, list[str]]]) -> dict[int, str]:
    """Place -> name of each column."""
    columns = {place: column for place, column in enumerate(head) if column}
    if twice := [column for column, count in Counter(columns.values()).items() if count > 1]:
        raise BadInput(f"{name} has two columns {twice[0]!r}; name each column once")
    for line, row in body:
        if any(cell.strip() for cell in row[max(columns) + 1 :]):
            raise BadInput(f"{name}, row {line}: more cells than columns; put text with commas in quotes")
    for place in set(range(max(columns))) - columns.keys():
        cells = [_at(row, place).strip() for _, row in body]
        counting = [[str(number) for number in range(first, first + len(cells))] for first in (0, 1)]
        if any(cells) and not (place == 0 and cells in counting):
            raise BadInput(f"{name}: column {place + 1} has no name; name each column once")
    return columns


def _at(row: list[str], place: int) -> str:
    return row[place] if place < len(row) else ""


def _csv_cells(text: str, name: str) -> tuple[str, list[list[str]]]:
    """The separator, and all rows."""
    if stated := SEPARATOR_LINE.match(text):
        separator, text = stated[1], text[stated.end() :]
    else:
        separator = max(SEPARATORS, key=lambda each: _fit(text, each))
    try:
        return separator, list(_csv_reader(text, separator))
    except csv.Error as error:
        raise BadInput(f"{name} cannot be read ({error}); save it as CSV in UTF-8") from error


def _fit(text: str, separator: str) -> tuple[bool, float, int]:
    """A measure of how well a separator divides the first rows."""
    counts: list[int] = []
    with suppress(csv.Error):
        counts.extend(len(row) for row in islice(_csv_reader(text, separator), TRIED_ROWS) if row)
    head = counts[0] if counts else 0
    return head > 1, counts.count(head) / max(len(counts), 1), head


def _csv_reader(text: str, separator: str) -> Iterator[list[str]]:
    return csv.reader(io.StringIO(text), delimiter=separator, strict=True)


def defuse(text: str) -> str:
    """`text` in a form that a spreadsheet shows instead of computing it (CWE-1236): an apostrophe keeps it text."""
    text = text.replace("\0", "")
    return "'" + text if _is_computed(text) else text


def restore(cell: str) -> str:
    """The text from which `defuse` made a cell."""
    return cell[1:] if cell[:1] == "'" and _is_computed(cell[1:]) else cell


def _is_computed(text: str) -> bool:
    """Whether a spreadsheet takes a text for a formula."""
    return text.lstrip().startswith(("=", "+", "-", "@")) or text[:1] in ("\t", "\r")
