# SPDX-License-Identifier: Apache-2.0
"""Excel files: numbers stay numbers, text stays text whatever it looks like, and each sheet is a table."""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from datetime import date, datetime
from pathlib import Path
from typing import Any, Final

from ..errors import BadInput
from .saving import explain_disk_errors, replacing

KEPT_DIGITS: Final = 15
"""A spreadsheet keeps no more digits of a number."""


def write_workbook(path: Path, sheets: Mapping[str, tuple[Sequence[str], Iterable[Sequence[Any]]]]) -> None:
    """Save tables as .xlsx.

    Args:
        sheets: name -> headings and rows; None and NaN are blank cells.
    """
    from openpyxl import Workbook
    from openpyxl.styles import Font
    from openpyxl.utils import get_column_letter

    book = Workbook()
    book.remove(book.active)
    for name, (headings, rows) in sheets.items():
        sheet = book.create_sheet(name)
        for line, cells in enumerate([headings, *rows], 1):
            for column, value in enumerate(cells, 1):
                if (plain := _plain(value)) is not None:
                    cell = sheet.cell(line, column, plain)
                    if isinstance(plain, str):
                        cell.data_type = "s"  # else what begins with = would be computed
        for column, heading in enumerate(headings, 1):
            sheet.cell(1, column).font = Font(bold=True)
            sheet.column_dimensions[get_column_letter(column)].width = max(9, min(40, len(str(heading)) + 2))
        sheet.freeze_panes = "B2"
    with explain_disk_errors(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as partial:
            book.save(partial)


def _plain(value: Any) -> Any:
    from openpyxl.cell.cell import ILLEGAL_CHARACTERS_RE

    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return None
    if isinstance(value, (list, tuple)):
        value = ";".join(map(str, value))
    if isinstance(value, str):
        return ILLEGAL_CHARACTERS_RE.sub("", value) or None
    return value


def is_workbook(content: bytes) -> bool:
    """Whether a file's content may be that of an .xlsx file, which is a ZIP archive."""
    return content.startswith(b"PK\x03\x04")


def workbook_cells(content: bytes, name: str) -> list[list[str]]:
    """Rows of the first sheet as text: whole numbers with all digits and without a point, dates as year-month-day.

    Raises:
        BadInput: the file is not an Excel file, or a cell has no value that can be trusted.
    """
    try:
        values, formulas = (_sheet(content, data_only) for data_only in (True, False))
    except Exception as error:  # openpyxl and its parsers raise all kinds of errors on unexpected files
        raise BadInput(f"{name} cannot be read as an Excel file ({error}); save it as CSV in UTF-8") from error
    cells = []
    for row, written in zip(values, formulas, strict=True):
        for value, source in zip(row, written, strict=True):
            where = f"{name}, cell {getattr(value, 'coordinate', '')}"
            # A formula without a value; an empty text is a value.
            if source.data_type == "f" and value.value is None and value.data_type == "n":
                raise BadInput(f"{where}: its formula was never computed; open the file in a spreadsheet and save it")
            number = value.value
            if isinstance(number, (int, float)) and abs(number) >= 10**KEPT_DIGITS:
                raise BadInput(f"{where}: a number keeps {KEPT_DIGITS} digits at most; store longer ones as text")
        cells.append([_shown(cell.value, cell.number_format or "") for cell in row])
    return cells


def _sheet(content: bytes, data_only: bool) -> list[tuple[Any, ...]]:
    """Cells of the first sheet: values, or formulas as they were written."""
    from openpyxl import load_workbook

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about styles and extensions, which are not read here
        sheet = load_workbook(io.BytesIO(content), read_only=True, data_only=data_only).worksheets[0]
        sheet.reset_dimensions()  # some programs write wrong dimensions
        return list(sheet.iter_rows())


def _shown(value: object, number_format: str) -> str:
    if value is None:
        return ""
    if isinstance(value, datetime) and not (value.hour or value.minute or value.second):
        value = value.date()
    if isinstance(value, date):
        return str(value)
    if isinstance(value, bool):
        return str(value).upper()
    if isinstance(value, float):
        value = int(value) if value.is_integer() else f"{value:.{KEPT_DIGITS}g}"
    padded = isinstance(value, int) and re.fullmatch("0+", number_format)
    return str(value).zfill(len(number_format)) if padded else str(value)
