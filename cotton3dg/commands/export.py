# SPDX-License-Identifier: Apache-2.0
"""A field's tables in the formats of databases and spreadsheets."""

from __future__ import annotations

from pathlib import Path

from ..command_options import FORMATS
from ..errors import unknown
from ..field.brapi import brapi_files
from ..field.miappe import DATA_FILE, data_file, miappe_sheets, missing
from ..field.other_formats import cottongen_sheets, data_package, fieldbook_files, workbook_sheets
from ..field.study import STUDY_FILE, read_study
from ..field.tables import Sheets, read_field
from ..io.saving import json_text, write_text_atomically
from ..io.workbook import write_workbook
from ..outputs import made_of, saving
from ..text import read_text
from ..workspace import OWNER_MARK


def export(folder: Path, kind: str, out: Path | None = None) -> str:
    """Write a field in a format; return a text on what it saved and what the lab has to add.

    Args:
        out: folder for the files; default: `export/KIND` in the field.
    Raises:
        BadUsage: an unknown format.
        MissingInput: no batch has run, or no plant has a result.
    """
    if kind not in FORMATS:
        raise unknown(f"--format {kind}", kind, FORMATS)
    field, study = read_field(folder), read_study(folder)
    target = out or folder / "export" / kind
    remark = ""
    texts: dict[str, str] = {}
    books: dict[str, Sheets] = {}
    if kind == "brapi":
        texts = {name: json_text(content) for name, content in brapi_files(field, study).items()}
    elif kind == "miappe":
        books["miappe.xlsx"] = miappe_sheets(field, study)
        texts[DATA_FILE] = data_file(field)
        if lacking := missing(books["miappe.xlsx"]):
            remark = f"\nMIAPPE also asks for {', '.join(lacking)}; write them into {folder / STUDY_FILE}"
    elif kind == "frictionless":
        # Copy the tables unchanged: a package's paths may not leave its folder.
        texts = {name: read_text(folder / name) for name in field.tables}
        texts["datapackage.json"] = json_text(data_package(field))
    elif kind == "cottongen":
        books["cottongen.xlsx"] = cottongen_sheets(field, study)
    elif kind == "fieldbook":
        texts = fieldbook_files(field)
    else:
        books[f"{field.name}.xlsx"] = workbook_sheets(field)
    with saving(target, made_of(f"export --format {kind}", folder)) as partial:
        for name, text in texts.items():
            write_text_atomically(partial / name, text)
        for name, sheets in books.items():
            write_workbook(partial / name, sheets)
    if out is None:
        (target.parent / OWNER_MARK).touch()  # so that `batch` does not take it for a plant
    plants = f"{len(field.plants)} {'plant' if len(field.plants) == 1 else 'plants'}"
    return f"{plants} saved in {target}: {', '.join([*texts, *books])}{remark}"
