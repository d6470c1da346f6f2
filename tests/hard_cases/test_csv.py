# SPDX-License-Identifier: Apache-2.0
"""Hard case 48: text that a spreadsheet would run as a formula."""

import csv
import io

import numpy as np
import pytest

from cotton3dg.core.columns import Column
from cotton3dg.io.tables import csv_text

COLUMNS = (Column("text", "", "text"), Column("number", "cm", "a number", 2))


def cells(text, number=0.0):
    return next(csv.reader(io.StringIO(csv_text(COLUMNS, [{"text": text, "number": number}]).split("\r\n", 1)[1])))


@pytest.mark.parametrize(
    "text",
    ["=1+1", "+1", "-1", "@SUM(A1)", "=cmd|' /C calc'!A0", "\t=1", "\r=1", "  =1", "-", "=\"a,b\"\n=2", "\0=1"],
)  # fmt: skip
def test_case_48_formulas_are_prefixed(text):
    assert cells(text)[0] == "'" + text.replace("\0", "")


@pytest.mark.parametrize("text", ["plant_017", "a=b", "3-4", "name@lab", "'quoted", "Größe", ""])
def test_case_48_other_text_is_left_alone(text):
    assert cells(text)[0] == text


@pytest.mark.parametrize("number", [-1.5, np.float32(-1.5), np.float64(-1.5)])
def test_case_48_negative_numbers_stay_numbers(number):
    assert cells("a", number)[1] == "-1.50"


def test_case_48_flags_are_guarded_too():
    assert cells(("=HYPERLINK(1)", "b"))[0] == "'=HYPERLINK(1)|b"
