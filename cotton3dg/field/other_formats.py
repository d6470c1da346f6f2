# SPDX-License-Identifier: Apache-2.0
"""A field in other formats: CottonGen's templates, Field Book's files, a data package and one workbook."""

from __future__ import annotations

import csv
import io
from typing import Any, Final

from ..core.columns import Column
from ..io.tables import is_number
from .study import Study
from .tables import BOLL_TABLE, FITS_TABLE, MEANS_TABLE, TABLE, TRAIT_COLUMNS, Field, Sheets, observed, shown

COTTONGEN_ROLES: Final = {"site_name": "site", "rep": "block", "plot": "plot", "row": "row", "position": "column"}
SHEETS: Final = {TABLE: "plants", BOLL_TABLE: "bolls", MEANS_TABLE: "genotypes", FITS_TABLE: "heritability"}


def cottongen_sheets(field: Field, study: Study) -> Sheets:
    """The templates `phenotype` and `descriptor`; a star marks required columns, # a descriptor's values."""
    dataset = study.get("Study", "studyId", field.name)
    traits = [column for column in TRAIT_COLUMNS if any(row.get(column.name) not in (None, "") for row in field.plants)]
    heads = ["*dataset_name", "*stock_name", "*genus", "*species", "*sample_ID", "evaluator", *COTTONGEN_ROLES]
    heads += ["data_year", "evaluation_date", *(f"#{column.name}" for column in traits)]
    rows = []
    for row in field.plants:
        stock = field.role(row, "genotype") or row["plant_id"]
        date = field.date(row)[:10]
        cells = [dataset, stock, "Gossypium", field.species(row), row["plant_id"], study.get("Person", "personName")]
        cells += [field.role(row, role) for role in COTTONGEN_ROLES.values()]
        rows.append([*cells, field.role(row, "season") or date[:4], date, *(row[column.name] for column in traits)])
    kinds = ["numeric" if is_number(column) else "text" for column in traits]
    descriptors = [
        [column.name, kind, column.ontology, column.scale_name, column.description]
        for column, kind in zip(traits, kinds, strict=True)
    ]
    return {
        "phenotype": (heads, rows),
        "descriptor": (["*descriptor_name", "*format", "trait_name", "data_unit", "definition"], descriptors),
    }


def fieldbook_files(field: Field) -> dict[str, str]:
    """File name -> CSV as the app Field Book exports it, in its database format and in its table format."""
    unique = "plant_id"
    book = [name for name in field.book_columns if name != unique]
    database: list[list[Any]] = [[unique, *book, "trait", "value", "timestamp", "person", "location", "number"]]
    table: list[list[Any]] = [[unique, *book, *(column.name for column in TRAIT_COLUMNS)]]
    for row in field.plants:
        own = [row[unique], *(row[name] or "" for name in book)]
        values = {column.name: shown(column, value) for column, value in observed(row)}
        time = field.date(row).replace("T", " ")
        database += [[*own, name, value, time, f"cotton3dg {row['version']}", "", 1] for name, value in values.items()]
        table.append([*own, *(values.get(column.name, "") for column in TRAIT_COLUMNS)])
    return {"fieldbook_database.csv": _quoted(database), "fieldbook_table.csv": _quoted(table)}


def _quoted(rows: list[list[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator="\n").writerows(rows)
    return text.getvalue()


def data_package(field: Field) -> dict[str, Any]:
    """`datapackage.json` (Data Package 1): a schema for each table, which are files beside it."""
    return {
        "profile": "tabular-data-package",
        "name": _slug(field.name),
        "title": field.name,
        "resources": [
            {
                "profile": "tabular-data-resource",
                "name": _slug(name.removesuffix(".csv")),
                "path": name,
                "format": "csv",
                "mediatype": "text/csv",
                "encoding": "utf-8",
                "dialect": {"delimiter": ",", "lineTerminator": "\r\n", "quoteChar": '"', "doubleQuote": True},
                "schema": {"fields": [_field(column) for column in table.columns], "missingValues": [""]},
            }
            for name, table in field.tables.items()
        ],
    }


def _field(column: Column) -> dict[str, Any]:
    kind = "string" if not is_number(column) else "integer" if column.digits is None else "number"
    descriptor: dict[str, Any] = {"name": column.name, "type": kind, "description": column.description}
    if column.unit:
        descriptor["unit"] = column.unit
    if column.ontology:
        descriptor["rdfType"] = f"https://cropontology.org/rdf/{column.ontology}"
    return descriptor


def _slug(text: str) -> str:
    slug = "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "-" for c in text.lower()).strip("-.")
    return slug or "field"


def workbook_sheets(field: Field) -> Sheets:
    """One sheet for each table, and one with units and meanings of all columns."""
    sheets: Sheets = {}
    for name, table in field.tables.items():
        heads = [column.name for column in table.columns]
        sheets[SHEETS[name]] = (heads, [[row[head] for head in heads] for row in table.rows])
    meanings = [
        [SHEETS[name], column.name, column.unit, column.description, column.ontology]
        for name, table in field.tables.items()
        for column in table.columns
    ]
    sheets["columns"] = (["sheet", "column", "unit", "description", "crop_ontology"], meanings)
    return sheets
