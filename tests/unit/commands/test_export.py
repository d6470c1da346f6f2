# SPDX-License-Identifier: Apache-2.0
"""A field in the formats of others, each judged by the published schema or template."""

import csv
import json
import re
import shutil
import subprocess
from datetime import datetime

import pytest
from openpyxl import load_workbook
from scenes.tiny_plant import ROOT
from typer.testing import CliRunner

from cotton3dg.batch import find_plants
from cotton3dg.cli.app import app
from cotton3dg.commands.export import FORMATS, export
from cotton3dg.core.columns import Column
from cotton3dg.errors import BadUsage, MissingInput
from cotton3dg.field.genotypes import FIT_COLUMNS, MEANS_COLUMNS, compare_genotypes
from cotton3dg.field.tables import BATCH_COLUMNS, TRAIT_COLUMNS, read_field
from cotton3dg.io.tables import BOLLS, csv_text

SCHEMAS = ROOT / "tests" / "schemas"
BOOK = ("genotype", "block", "treatment", "row", "col", "date", "year", "note")
STUDY = """
[Investigation]
license = "CC BY 4.0"
[Study]
studyId = "NC-2026"
studyTitle = "Yield trial"
studyStartDate = "2026-05-04"
contactInst = "A lab, Raleigh"
locationCountry = "US"
siteName = "Clayton"
expeDesignDesc = "randomised complete blocks"
growthFacilityDesc = "field"
[Person]
personName = "A. Breeder"
personRole = "data submitter"
personAffiliation = "A lab"
"""


@pytest.fixture
def field(tmp_path):
    folder = tmp_path / "field 2026"
    (folder / "p0").mkdir(parents=True)
    (folder / "p0" / "walk.mp4").touch()
    rows = []
    for k in range(7):
        row = {column.name: None for column in BATCH_COLUMNS} | {"folder": f"p{k}", "state": "done", "exit_code": 0}
        if k == 6:
            row |= {"state": "failed", "exit_code": 4, "reason": "dark; film it"}
        else:
            row |= {column.name: 1.25 * k + 3 if column.digits is not None else k for column in TRAIT_COLUMNS}
            row |= {"plant_id": "=1+1" if k == 5 else f"p{k}", "seconds": 61.0, "version": "0.1.0"}
            row |= {"boll_volume_cm3": None} if k == 4 else {}
        cells = (
            f"G{k // 2}",
            str(k % 2),
            "ab"[k % 2],
            str(k),
            "3",
            "2026-10-12",
            "2026",
            '=HYPERLINK("x")' if k else "é",
        )
        rows.append(row | dict(zip(BOOK, cells if k < 6 else [""] * 8, strict=True)))
    columns = [*BATCH_COLUMNS, *(Column(name, "", "") for name in BOOK)]
    (folder / "batch.csv").write_text(csv_text(columns, rows), newline="")
    bolls = [
        {column.name: 2.5 if column.digits is not None else 1 for column in BOLLS} | {"plant_id": "p0", "qc_flags": ""}
    ]
    (folder / "batch_bolls.csv").write_text(csv_text(BOLLS, bolls), newline="")
    means, fits = compare_genotypes([row for row in rows if row["plant_id"]], BOOK)
    (folder / "genotypes.csv").write_text(csv_text(MEANS_COLUMNS, map(vars, means)), newline="")
    (folder / "heritability.csv").write_text(csv_text(FIT_COLUMNS, map(vars, fits)), newline="")
    (folder / "study.toml").write_text(STUDY)
    return folder


def test_brapi_answers_are_valid(field):
    from jsonschema import Draft202012Validator

    export(field, "brapi")
    schemas = json.loads((SCHEMAS / "brapi_2_1.json").read_text())
    answers = {}
    for name, kind in (("observationunits", "ObservationUnit"), ("variables", "ObservationVariable"),
                       ("observations", "Observation")):  # fmt: skip
        answer = json.loads((field / "export" / "brapi" / f"{name}.json").read_text())
        checker = Draft202012Validator.FORMAT_CHECKER
        Draft202012Validator({**schemas, "$ref": "#/$defs/metadata"}).validate(answer["metadata"])
        validator = Draft202012Validator({**schemas, "$ref": f"#/$defs/{kind}"}, format_checker=checker)
        known = set(_properties(schemas["$defs"], kind))
        for item in answer["result"]["data"]:
            validator.validate(item)
            assert set(item) <= known  # nothing that BrAPI has no name for
        answers[name] = answer["result"]["data"]
    assert len(answers["observationunits"]) == 6
    units = {unit["observationUnitDbId"] for unit in answers["observationunits"]}
    variables = {item["observationVariableDbId"] for item in answers["variables"]}
    assert "CO_358:0001327" in variables
    assert {item["observationUnitDbId"] for item in answers["observations"]} == units
    assert {item["observationVariableDbId"] for item in answers["observations"]} <= variables
    assert len(answers["observations"]) == 6 * len(TRAIT_COLUMNS) - 1  # what is blank is not observed
    for item in answers["observations"]:
        assert isinstance(item["value"], str) and float(item["value"]) >= 0
        datetime.fromisoformat(item["observationTimeStamp"])
    broken = answers["observations"][0] | {"value": 7}
    assert not Draft202012Validator({**schemas, "$ref": "#/$defs/Observation"}).is_valid(broken)


def _properties(definitions, kind):
    """Names that a schema and those that it builds on know."""
    schema = definitions[kind]
    for part in schema.get("allOf", [schema]):
        yield from part.get("properties", ())
        if "$ref" in part:
            yield from _properties(definitions, part["$ref"].rpartition("/")[2])


def test_miappe_has_the_templates_columns_and_all_that_it_asks_for(field):
    assert "also asks for" not in export(field, "miappe")
    template = {}
    with (SCHEMAS / "miappe_1_2.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            template.setdefault(row["sheet"], []).append((row["column"], row["cardinality"]))
    book = load_workbook(field / "export" / "miappe" / "miappe.xlsx")
    assert [name for name in template if name in book.sheetnames] == book.sheetnames
    for sheet in book:
        head, *rows = sheet.iter_rows(values_only=True)
        assert list(head) == [name for name, _ in template[sheet.title]]
        assert rows
        for number, (name, cardinality) in enumerate(template[sheet.title]):
            if cardinality in ("1", "1+"):
                assert all(row[number] not in (None, "") for row in rows), f"{sheet.title}.{name}"
    data = (field / "export" / "miappe" / "observations.tsv").read_text().splitlines()
    variables = {row[1] for row in list(book["Observed Variable"].iter_rows(values_only=True))[1:]}
    assert set(data[0].split("\t")[1:]) == variables
    units = [row[2] for row in list(book["Observation Unit"].iter_rows(values_only=True))[1:]]
    assert [line.split("\t")[0] for line in data[1:]] == units
    materials = [row[1] for row in list(book["Biological Material"].iter_rows(values_only=True))[1:]]
    assert materials == ["G0", "G1", "G2"]
    (field / "study.toml").unlink()
    assert "Study.contactInst, Study.locationCountry" in export(field, "miappe")


def test_the_data_package_is_valid(field):
    from frictionless import Package

    export(field, "frictionless")
    report = Package(str(field / "export" / "frictionless" / "datapackage.json")).validate()
    assert report.valid, report.flatten()
    names = [
        resource.name for resource in Package(str(field / "export" / "frictionless" / "datapackage.json")).resources
    ]
    assert names == ["batch", "batch_bolls", "genotypes", "heritability"]
    table = field / "export" / "frictionless" / "batch.csv"
    table.write_bytes(table.read_bytes().replace(b"61.0", b"an hour", 1))
    assert not Package(str(field / "export" / "frictionless" / "datapackage.json")).validate().valid


COTTONGEN_REQUIRED = {"*dataset_name", "*stock_name", "*genus", "*species", "*sample_ID"}
COTTONGEN_KNOWN = {
    "primary_order", "secondary_order", "clone_ID", "evaluator", "site_name", "rootstock", "scion", "previous_entry",
    "data_year", "institutional_name", "rep", "plot", "row", "position", "plant_date", "pick_date", "evaluation_date",
}  # fmt: skip
"""Columns of the template phenotype, www.cottongen.org/mcl/template/view/18."""


def test_cottongen_has_the_columns_of_its_template(field):
    export(field, "cottongen")
    book = load_workbook(field / "export" / "cottongen" / "cottongen.xlsx")
    head, *rows = book["phenotype"].iter_rows(values_only=True)
    plain = {name for name in head if not name.startswith("#")}
    assert COTTONGEN_REQUIRED <= plain <= COTTONGEN_REQUIRED | COTTONGEN_KNOWN
    assert all(row[head.index(name)] for row in rows for name in COTTONGEN_REQUIRED)
    assert len({row[head.index("*sample_ID")] for row in rows}) == len(rows) == 6
    told = {row[0] for row in list(book["descriptor"].iter_rows(values_only=True))[1:]}
    assert {name[1:] for name in head if name.startswith("#")} == told
    assert rows[1][head.index("#plant_height_cm")] == 4.25


def test_field_book_files(field):
    export(field, "fieldbook")
    with (field / "export" / "fieldbook" / "fieldbook_database.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["plant_id", *BOOK, "trait", "value", "timestamp", "person", "location", "number"]
    assert len({(row["plant_id"], row["trait"]) for row in rows}) == len(rows) == 6 * len(TRAIT_COLUMNS) - 1
    with (field / "export" / "fieldbook" / "fieldbook_table.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == 6 and table[4]["boll_volume_cm3"] == ""
    # The app refuses these in headings.
    assert not any(re.search(r'[/?<>\\*|"]', name) for name in table[0])


def test_the_workbook_holds_numbers_as_numbers_and_text_as_text(field):
    export(field, "xlsx")
    book = load_workbook(field / "export" / "xlsx" / "field 2026.xlsx")
    assert book.sheetnames == ["plants", "bolls", "genotypes", "heritability", "columns"]
    head = [cell.value for cell in book["plants"][1]]
    for row in list(book["plants"].iter_rows())[1:7]:
        cells = dict(zip(head, row, strict=True))
        assert cells["plant_height_cm"].data_type == "n" and cells["boll_count"].data_type == "n"
        assert cells["plant_id"].data_type == cells["note"].data_type == "s"
    units = {(row[0], row[1]): row[2] for row in book["columns"].iter_rows(values_only=True)}
    assert units["plants", "boll_volume_cm3"] == "cm3"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("soffice") is None, reason="no LibreOffice; apt-get install libreoffice-calc-nogui")
def test_libreoffice_opens_the_workbook(field, tmp_path):
    export(field, "xlsx")
    book = field / "export" / "xlsx" / "field 2026.xlsx"
    subprocess.run(
        ["soffice", f"-env:UserInstallation={(tmp_path / 'profile').as_uri()}", "--headless", "--convert-to",
         "fods", "--outdir", tmp_path, book],
        check=True, capture_output=True, timeout=180,
    )  # fmt: skip
    text = (tmp_path / "field 2026.fods").read_text()
    assert text.count("table:formula") == 0  # a plant named =1+1 is a name
    plants = text.split('table:name="plants"')[1].split("</table:table>")[0]
    first = plants.split("</table:table-row>")[1]
    numbers = [cell for cell in re.findall(r"<table:table-cell[^>]*>", first) if 'value-type="float"' in cell]
    repeats = [re.search(r'number-columns-repeated="(\d+)"', cell) for cell in numbers]
    # Exit code and seconds, too.
    assert sum(int(found[1]) if found else 1 for found in repeats) == 2 + len(TRAIT_COLUMNS)


def test_every_database_learns_of_flags_and_corrections(field):
    with (field / "batch.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row |= {"qc_flags": "", "corrections": ""}
    rows[1] |= {"qc_flags": "doubtful_bolls|blurred", "corrections": "2"}
    with (field / "batch.csv").open("w", newline="") as file:
        csv.DictWriter(file, rows[0].keys()).writeheader()
        csv.DictWriter(file, rows[0].keys()).writerows(rows)
    for kind in ("brapi", "miappe", "cottongen", "fieldbook"):
        export(field, kind)
    out = field / "export"
    said = {
        item["observationVariableName"]: item["value"]
        for item in json.loads((out / "brapi" / "observations.json").read_text())["result"]["data"]
        if item["observationVariableName"] in ("qc_flags", "corrections")
    }
    assert said == {"qc_flags": "doubtful_bolls|blurred", "corrections": "2"}
    (scale,) = [
        item["scale"]
        for item in json.loads((out / "brapi" / "variables.json").read_text())["result"]["data"]
        if item["observationVariableName"] == "qc_flags"
    ]
    assert (scale["dataType"], scale["units"]) == ("Text", "text")
    tables = [list(csv.DictReader((out / "miappe" / "observations.tsv").open(), delimiter="\t"))]
    tables.append(list(csv.DictReader((out / "fieldbook" / "fieldbook_table.csv").open())))
    head, *cells = load_workbook(out / "cottongen" / "cottongen.xlsx")["phenotype"].iter_rows(values_only=True)
    tables.append([dict(zip((name.strip("#") for name in head), row, strict=True)) for row in cells])
    for table in tables:
        assert [row["qc_flags"] or "" for row in table] == ["", "doubtful_bolls|blurred", "", "", "", ""]
        assert str(table[1]["corrections"]) == "2"


def test_an_export_over_a_file_of_the_users_changes_nothing(field):
    (field / "export" / "xlsx").mkdir(parents=True)
    (field / "export" / "xlsx" / f"{field.name}.xlsx").write_text("mine")
    with pytest.raises(BadUsage, match="was not made by this command"):
        export(field, "xlsx")
    assert [path.name for path in (field / "export").rglob("*")] == ["xlsx", f"{field.name}.xlsx"]


def test_an_export_is_no_plant_and_what_is_wrong_is_told(field, tmp_path):
    for kind in FORMATS:
        export(field, kind)
    assert [plant.name for plant in find_plants(field)] == ["p0"]
    with pytest.raises(BadUsage, match="--format csv"):
        export(field, "csv")
    with pytest.raises(MissingInput, match="cotton3dg batch"):
        export(tmp_path, "xlsx")
    (field / "study.toml").write_text("[Lab]\nx = 1\n")
    with pytest.raises(BadUsage, match=r"\[Lab\] is unknown"):
        export(field, "brapi")
    assert read_field(field).species({"species": "G. barbadense"}) == "hirsutum"  # no such column


def test_nothing_is_written_into_a_folder_that_no_batch_has_run(tmp_path):
    (tmp_path / "plant_1").mkdir()
    (tmp_path / "plant_1" / "walk.mp4").write_bytes(b"film")
    done = CliRunner().invoke(app, ["export", str(tmp_path)])
    assert done.exit_code == MissingInput.exit_code and "batch" in done.output
    assert [path.name for path in tmp_path.iterdir()] == ["plant_1"]
