# SPDX-License-Identifier: Apache-2.0
"""Tables as spreadsheets of all countries save them."""

from __future__ import annotations

import math
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from openpyxl import Workbook

from cotton3dg.errors import BadInput
from cotton3dg.io.picks import read_picks
from cotton3dg.io.prompt_table import read_prompts
from cotton3dg.io.spreadsheet import Table, read_table


def table_of(folder: Path, text: str) -> Table:
    (folder / "t.csv").write_text(text, encoding="utf-8")
    return read_table(folder / "t.csv")


def workbook_of(folder: Path, *rows: list[Any], formats: dict[str, str] | None = None) -> Path:
    book = Workbook()
    for row in rows:
        book.active.append(row)
    for cell, number_format in (formats or {}).items():
        book.active[cell].number_format = number_format
    book.save(folder / "t.xlsx")
    return folder / "t.xlsx"


@pytest.mark.parametrize(
    "text",
    [
        "a,b,c\n1,2.5,x\n2,,y\n",
        'a,b,c\n1,"2,5",x\n2,"",y\n',
        "a;b;c\n1;2,5;x\n2;;y\n",
        "a\tb\tc\n1\t2,5\tx\n2\tNA\ty\n",
        "sep=;\na;b;c\n1;2,5;x\n2;;y\n",
        '"sep=|"\na|b|c\n1|2.5|x\n2||y\n',
        "\n;;\na;b;c;;\n1;2,5;x;;\n\n2;;y;;\n;;;;\n",
        '"","a","b","c"\n"1",1,2.5,"x"\n"2",2,NA,"y"\n',
    ],
)
def test_every_dialect_is_the_same_table(tmp_path: Path, text: str) -> None:
    table = table_of(tmp_path, text)
    assert table.columns == ("a", "b", "c")
    assert table.numbers("a").tolist() == [1, 2]
    assert np.array_equal(table.numbers("b"), [2.5, math.nan], equal_nan=True)
    assert [row["c"] for row in table.rows] == ["x", "y"]


def test_commas_in_a_header_do_not_hide_the_semicolons(tmp_path: Path) -> None:
    table = table_of(tmp_path, "id;weight, g;height, cm\nA;1,5;2,5\n")
    assert table.columns == ("id", "weight, g", "height, cm")
    assert table.numbers("weight, g").tolist() == [1.5]


@pytest.mark.parametrize(
    ("cells", "numbers"),
    [
        (["1.234", "2.5"], [1.234, 2.5]),
        (["1,234", "2,5"], [1.234, 2.5]),
        (["1.234,5", "1 234,5"], [1234.5, 1234.5]),
        (["1,234.5", "1,234,567"], [1234.5, 1234567]),
        (["1'234.5", "−3"], [1234.5, -3]),
        (["1.234", "1.235"], [1.234, 1.235]),
        (["NA", "-"], [math.nan, math.nan]),
    ],
)
def test_numbers_of_all_countries(tmp_path: Path, cells: list[str], numbers: list[float]) -> None:
    table = table_of(tmp_path, "x\n" + "".join(f'"{cell}"\n' for cell in cells))
    assert np.array_equal(table.numbers("x"), numbers, equal_nan=True)


def test_another_column_shows_what_a_comma_is(tmp_path: Path) -> None:
    assert table_of(tmp_path, "x\ty\n1,234\t0,5\n").numbers("x").tolist() == [1.234]
    assert table_of(tmp_path, "x;y\n1,234;a\n").numbers("x").tolist() == [1.234]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("id,x\nA,1\nB,73.8 cm\n", r"t\.csv, row 3, column x: '73.8 cm' is not a number; write a number alone"),
        ("id,x\n\nB,high\n", "row 3, column x: 'high' is not a number"),
        ("id,x\nA,inf\n", "'inf' is not a number"),
        ("id,x\nA,1_000\n", "'1_000' is not a number"),
        ('id,x\nA,"1,234"\n', "'1,234' may be 1234 or 1.234; write one of them"),
        ("id;x\nA;1.234\n", "'1.234' may be 1.234 or 1234"),
        ('id,x\nA,"1,234"\nB,2.5\n', "'1,234' may be 1234 or 1.234"),
        ('id,x\nA,"1,5"\nB,2.5\nC,1.234\n', "row 4, column x: '1.234' may be"),
    ],
)
def test_a_cell_that_is_no_certain_number_is_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        table_of(tmp_path, text).numbers("x")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,a\n1,2\n", "t.csv has two columns 'a'; name each column once"),
        ("a,,b\n1,2,3\n", "t.csv: column 2 has no name"),
        (",b\nA,3\n", "t.csv: column 1 has no name"),
        ("a,b\n1,#N/A\n", "t.csv, row 2: a cell is the error #N/A; mend its formula"),
        ('a,b\n1,"2\n', "cannot be read"),
    ],
)
def test_a_table_that_is_not_whole_is_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        table_of(tmp_path, text)


def test_a_workbook_keeps_all_digits_of_a_number(tmp_path: Path) -> None:
    """20261001 stored as a fraction, as POI and pandas do, became 2.0261e+07."""
    path = workbook_of(
        tmp_path,
        ["id", "barcode", "text", "sown", "rate", "padded", "sum", "blank"],
        [20261001.0, 4006381333931.0, "0017", datetime(2026, 5, 4), 0.1 + 0.2, 17, True, None],
        formats={"F2": "0000"},
    )
    assert list(read_table(path).rows[0].values()) == [
        "20261001", "4006381333931", "0017", "2026-05-04", "0.3", "0017", "TRUE", "",
    ]  # fmt: skip
    assert read_table(path.rename(tmp_path / "t.csv")).rows[0]["id"] == "20261001"


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("=1+1", r"t\.xlsx, cell B3: its formula was never computed"),
        ("#N/A", r"t\.xlsx, row 3: a cell is the error #N/A"),
        (1234567890123456789, r"t\.xlsx, cell B3: a number keeps 15 digits"),
    ],
)
def test_a_cell_of_a_workbook_without_a_value_is_named(tmp_path: Path, cell: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        read_table(workbook_of(tmp_path, ["id", "x"], ["A", 1], ["B", cell]))


def test_a_number_of_a_workbook_has_no_thousands(tmp_path: Path) -> None:
    """The text beside it has a decimal comma; 76.125 is no 76125."""
    table = read_table(workbook_of(tmp_path, ["x"], ["73,8"], [76.125]))
    with pytest.raises(BadInput, match=r"row 3, column x: '76\.125' may be"):
        table.numbers("x")


def test_picks_and_prompts_are_tables_like_others(tmp_path: Path) -> None:
    (tmp_path / "picks.csv").write_text("point;image;x_px;y_px\nA;0.jpg;1,5;2\n", encoding="utf-16")
    assert read_picks(tmp_path / "picks.csv")["A"]["0.jpg"].tolist() == [2.0, 2.5]
    (tmp_path / "picks.csv").write_text("point,image,x_px,y_px\nA,0.jpg,1px,2\n", encoding="utf-8")
    with pytest.raises(BadInput, match=r"picks\.csv, row 2, column x_px: '1px' is not a number"):
        read_picks(tmp_path / "picks.csv")
    (tmp_path / "prompts.csv").write_text("sep=;\nimage;x;y\n0.jpg;1,5;2\n", encoding="utf-8-sig")
    assert read_prompts(tmp_path / "prompts.csv")["0"].tolist() == [[1.5, 2.0]]
    (tmp_path / "prompts.csv").write_text("image,x,y\n0.jpg,1,two\n", encoding="utf-8")
    with pytest.raises(BadInput, match=r"prompts\.csv, row 2, column y: 'two' is not a number"):
        read_prompts(tmp_path / "prompts.csv")
