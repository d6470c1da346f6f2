"""Excel files: numbers as numbers, text as text whatever it looks like, a sheet a table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from .saving import explain_disk_errors, replacing


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
