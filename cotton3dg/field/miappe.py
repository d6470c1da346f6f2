# SPDX-License-Identifier: Apache-2.0
"""A field as MIAPPE 1.2 requires it: the sheets of its spreadsheet template, with columns by their code names."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any, Final

from .study import Study
from .tables import SPECIES, TRAIT_COLUMNS, Field, Sheets, observed, shown

DATA_FILE: Final = "observations.tsv"

INVESTIGATION: Final = (
    "investigationId", "investigationTitle", "investigationDescription", "submissionDate", "publicReleaseDate",
    "license", "miappeVersion", "associatedPublication",
)  # fmt: skip
STUDY: Final = (
    "studyId", "studyTitle", "studyDescription", "studyStartDate", "studyEndDate", "contactInst", "locationCountry",
    "siteName", "locationLatitude", "locationLongitude", "locationAltitude", "expeDesignDesc", "expeDesignType",
    "obsUnitLevelHierarchy", "obsUnitDesc", "growthFacilityDesc", "growthFacilityType", "culturalPractice",
    "expeDesignMap",
)  # fmt: skip
PERSON: Final = ("studyId", "personName", "personEmail", "personId", "personRole", "personAffiliation")
MATERIAL: Final = (
    "studyId", "biologicalMaterialId", "biologicalMaterialExtId", "organism", "genus", "species", "infraspecificName",
    "biologicalMaterialLatitude", "biologicalMaterialLongitude", "biologicalMaterialAltitude",
    "biologicalMaterialCoordUncertainty", "biologicalMaterialPreprocessing", "materialSourceId", "materialSourceDoi",
    "materialSourceAccNumber", "materialSourceAccName", "materialSourceInstCode", "materialSourceInstName",
    "materialSourceOtherIds", "materialSourceLatitude", "materialSourceLongitude", "materialSourceAltitude",
    "materialSourceCoordUncertainty", "materialSourceDesc",
)  # fmt: skip
UNIT: Final = (
    "studyId", "biologicalMaterialId", "obsUnitId", "obsUnitType", "externalId", "spatialDistribution",
    "obsUnitFactorValue",
)  # fmt: skip
FACTOR: Final = ("studyId", "expeFactorType", "expeFactorDesc", "expeFactorValues")
VARIABLE: Final = (
    "studyId", "variableId", "variableName", "variableAccNumber", "traitName", "traitEntity",
    "traitEntityAccessionNumber", "traitCharacteristic", "traitCharacteristicAccessionNumber", "traitAccNumber",
    "methodName", "methodAccNumber", "methodDesc", "methodRef", "scaleName", "scaleAccNumber", "timeScale",
)  # fmt: skip
REQUIRED: Final = {
    "Investigation": ("investigationTitle", "miappeVersion"),
    "Study": ("studyTitle", "studyStartDate", "contactInst", "locationCountry", "siteName", "expeDesignDesc",
              "obsUnitDesc", "growthFacilityDesc"),
    "Person": ("personName", "personRole", "personAffiliation"),
}  # fmt: skip
"""The entries that MIAPPE requires and only the lab can give."""


def miappe_sheets(field: Field, study: Study) -> Sheets:
    """Sheet -> columns and rows, in the order of the template; empty sheets are left out."""
    study_id = study.get("Study", "studyId", field.name)
    dates = sorted(filter(None, (field.date(row) for row in field.plants)))
    defaults = {
        "Investigation": {"investigationId": field.name, "investigationTitle": field.name, "miappeVersion": "1.2"},
        "Study": {
            "studyId": study_id,
            "studyTitle": field.name,
            "studyStartDate": dates[0] if dates else "",
            "studyEndDate": dates[-1] if dates else "",
            "siteName": next(filter(None, (field.role(row, "site") for row in field.plants)), ""),
            "obsUnitLevelHierarchy": ">".join([role for role in ("block", "plot") if role in field.roles] + ["plant"]),
            "obsUnitDesc": "single plants, defoliated, on a table",
        },
        "Person": {"studyId": study_id},
    }

    def sheet_of(section: str, columns: Sequence[str]) -> tuple[Sequence[str], list[list[Any]]]:
        values = defaults[section] | dict(study.sections.get(section, {}))
        return columns, [[values.get(name, "") for name in columns]]

    sheets: Sheets = {
        "Investigation": sheet_of("Investigation", INVESTIGATION),
        "Study": sheet_of("Study", STUDY),
        "Person": sheet_of("Person", PERSON),
        "Data file": (
            ("studyId", "dataFileLink", "dataFileDesc", "dataFileVersion"),
            [[study_id, DATA_FILE, "tab-separated text, a row for each plant", "1"]],
        ),
        "Biological Material": (MATERIAL, _materials(field, study_id)),
    }
    if factor := _factor(field):
        sheets["Experimental Factor"] = (FACTOR, [[study_id, *factor]])
    sheets["Observation Unit"] = (UNIT, [_unit(field, row, study_id) for row in field.plants])
    sheets["Observed Variable"] = (VARIABLE, [_variable(study_id, column) for column in TRAIT_COLUMNS])
    return sheets


def missing(sheets: Sheets) -> list[str]:
    """Entries that MIAPPE requires and nobody gives, as `Sheet.column`."""
    found = []
    for sheet, names in REQUIRED.items():
        columns, rows = sheets[sheet]
        found += [f"{sheet}.{name}" for name in names if not rows[0][columns.index(name)]]
    return found


def data_file(field: Field) -> str:
    """The observations that the sheet `Data file` names: one row per plant, one column per variable."""
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    writer.writerow(["obsUnitId", *(column.ontology or column.name for column in TRAIT_COLUMNS)])
    for row in field.plants:
        values = {column.name: shown(column, value) for column, value in observed(row)}
        writer.writerow([row["plant_id"], *(values.get(column.name, "") for column in TRAIT_COLUMNS)])
    return text.getvalue()


def _materials(field: Field, study_id: str) -> list[list[Any]]:
    """A row for each genotype, with the species of its first plant."""
    first = {_material_of(field, row): row for row in reversed(field.plants)}
    rows = []
    for name in dict.fromkeys(_material_of(field, row) for row in field.plants):
        species = field.species(first[name])
        taxon = f"NCBITAXON:{SPECIES[species]}" if species in SPECIES else f"Gossypium {species}"
        known = {
            "studyId": study_id,
            "biologicalMaterialId": name,
            "organism": taxon,
            "genus": "Gossypium",
            "species": species,
            "materialSourceAccName": name,
        }
        rows.append([known.get(column, "") for column in MATERIAL])
    return rows


def _material_of(field: Field, row: dict[str, Any]) -> str:
    return field.role(row, "genotype") or row["plant_id"]


def _factor(field: Field) -> list[str]:
    values = list(dict.fromkeys(filter(None, (field.role(row, "treatment") for row in field.plants))))
    return [field.roles["treatment"], "as the field book has it", ";".join(values)] if values else []


def _unit(field: Field, row: dict[str, Any], study_id: str) -> list[Any]:
    places = [f"{role}:{field.role(row, role)}" for role in ("block", "plot", "row", "column") if field.role(row, role)]
    known = {
        "studyId": study_id,
        "biologicalMaterialId": _material_of(field, row),
        "obsUnitId": row["plant_id"],
        "obsUnitType": "plant",
        "spatialDistribution": ";".join(places),
        "obsUnitFactorValue": field.role(row, "treatment"),
    }
    return [known.get(column, "") for column in UNIT]


def _variable(study_id: str, column: Any) -> list[Any]:
    known = {
        "studyId": study_id,
        "variableId": column.ontology or column.name,
        "variableName": column.name,
        "variableAccNumber": column.ontology,
        "traitName": column.description,
        "methodName": "cotton3dg",
        "methodDesc": "3D Gaussian splatting of a video of one turn around the plant",
        "scaleName": column.scale_name,
    }
    return [known.get(name, "") for name in VARIABLE]
