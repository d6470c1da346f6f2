# SPDX-License-Identifier: Apache-2.0
"""Field books as spreadsheets of all countries write them."""

import pytest
from openpyxl import Workbook

from cotton3dg.errors import BadInput, BadUsage
from cotton3dg.io.fieldbook import read_fieldbook

TEXT = "plant_id,genotype,block\nA1,Größe,1\nA2,DP 1646,2\n"


@pytest.mark.parametrize(
    "content",
    [
        TEXT.encode(),
        b"\xef\xbb\xbf" + TEXT.encode(),
        TEXT.replace(",", ";").replace("\n", "\r\n").encode("cp1252"),
        TEXT.replace(",", "\t").encode(),
        (TEXT + ",,\n\n").encode(),
        TEXT.encode("utf-16"),
        TEXT.replace(",", "\t").replace("\n", "\r").encode("utf-16-be").join([b"\xfe\xff", b""]),
        ("sep=;\n" + TEXT.replace(",", ";")).replace("\n", "\r\n").encode(),
        TEXT.replace(",", ",,").encode(),
    ],
)
def test_every_dialect_is_read(tmp_path, content):
    (tmp_path / "book.csv").write_bytes(content)
    book = read_fieldbook(tmp_path / "book.csv")
    assert book.id_column == "plant_id"
    assert book.columns == ("genotype", "block")
    assert book.rows == {"A1": {"genotype": "Größe", "block": "1"}, "A2": {"genotype": "DP 1646", "block": "2"}}


def test_excel_is_read_as_it_is_shown(tmp_path):
    from datetime import datetime

    book = Workbook()
    book.active.append(["Plot ID", "genotype", "sown", "rate"])
    book.active.append([17, "A", datetime(2026, 5, 4), 0.5])
    book.active.append([None, None, None, None])
    book.save(tmp_path / "book.xlsx")
    read = read_fieldbook(tmp_path / "book.xlsx")
    assert read.id_column == "Plot ID"
    assert read.rows == {"17": {"genotype": "A", "sown": "2026-05-04", "rate": "0.5"}}


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("plant_id,x\nA,1\nA,2\n", BadInput, "rows 2 and 3"),
        ("plant_id,x\n,1\n", BadInput, "row 2: no plant_id"),
        ("plant_id,x\nA,1,2\n", BadInput, "row 2: more cells"),
        ("plant_id,x,x\nA,1,2\n", BadInput, "two columns 'x'"),
        ("plant_id,x\n", BadInput, "no rows"),
        ("plant_id,,x\nA,1,2\n", BadInput, "column 2 has no name"),
        ("", BadInput, "no rows"),
        ("name,x\nA,1\n", BadUsage, "--id-column 'name'"),
    ],
)
def test_what_is_wrong_is_told(tmp_path, text, error, words):
    (tmp_path / "book.csv").write_text(text)
    with pytest.raises(error, match=words):
        read_fieldbook(tmp_path / "book.csv")


def test_another_column_and_no_file(tmp_path):
    (tmp_path / "book.csv").write_text("name,x\nA,1\n")
    assert list(read_fieldbook(tmp_path / "book.csv", "x").rows) == ["1"]
    with pytest.raises(BadUsage, match="no column 'y'"):
        read_fieldbook(tmp_path / "book.csv", "y")
    with pytest.raises(BadInput, match="cannot be read"):
        read_fieldbook(tmp_path / "none.csv")
    (tmp_path / "book.xlsx").write_bytes(b"no zip")
    with pytest.raises(BadInput, match="cannot be read as an Excel file"):
        read_fieldbook(tmp_path / "book.xlsx")
