# SPDX-License-Identifier: Apache-2.0
"""A field in the form of the Breeding API (BrAPI 2.1): units, variables and observations, as a server answers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Final

from ..core.columns import Column
from .study import Study
from .tables import TRAIT_COLUMNS, Field, observed, shown

ONTOLOGY: Final = {"ontologyDbId": "CO_358", "ontologyName": "Crop Ontology, cotton"}
METHOD: Final = "cotton3dg"


def brapi_files(field: Field, study: Study) -> dict[str, Any]:
    """File name -> its content: answers of /observationunits, /variables and /observations."""
    study_id = study.get("Study", "studyId", field.name)
    return {
        "observationunits.json": _answer([_unit(field, row, study_id, study) for row in field.plants]),
        "variables.json": _answer([_variable(column) for column in TRAIT_COLUMNS]),
        "observations.json": _answer(
            [
                _observation(field, row, column, value, study_id)
                for row in field.plants
                for column, value in observed(row)
            ]
        ),
    }


def _answer(data: Sequence[Any]) -> dict[str, Any]:
    pages = {"currentPage": 0, "pageSize": len(data), "totalCount": len(data), "totalPages": 1}
    return {
        "@context": ["https://brapi.org/jsonld/context/metadata.jsonld"],
        "metadata": {"datafiles": [], "pagination": pages, "status": []},
        "result": {"data": list(data)},
    }


def _unit(field: Field, row: dict[str, Any], study_id: str, study: Study) -> dict[str, Any]:
    levels = [("block", 1), ("plot", 2)]
    above = [
        {"levelName": name, "levelOrder": order, "levelCode": field.role(row, name)}
        for name, order in levels
        if field.role(row, name)
    ]
    position: dict[str, Any] = {
        "observationLevel": {"levelName": "plant", "levelOrder": 3, "levelCode": row["plant_id"]},
        "observationLevelRelationships": above,
    }
    for axis, role, kind in (("X", "column", "GRID_COL"), ("Y", "row", "GRID_ROW")):
        if field.role(row, role):
            position |= {f"positionCoordinate{axis}": field.role(row, role), f"positionCoordinate{axis}Type": kind}
    unit: dict[str, Any] = {
        "observationUnitDbId": row["plant_id"],
        "observationUnitName": row["plant_id"],
        "observationUnitPosition": position,
        "studyDbId": study_id,
        "studyName": study.get("Study", "studyTitle", field.name),
        "additionalInfo": {name: str(row[name]) for name in field.book_columns if row[name] is not None},
    }
    if germplasm := field.role(row, "genotype"):
        unit |= {"germplasmDbId": germplasm, "germplasmName": germplasm}
    if site := field.role(row, "site"):
        unit["locationName"] = site
    if treatment := field.role(row, "treatment"):
        unit["treatments"] = [{"factor": field.roles["treatment"], "modality": treatment}]
    return unit


def _variable(column: Column) -> dict[str, Any]:
    """One trait, with the Crop Ontology's term where there is one."""
    reference = {"ontologyReference": ONTOLOGY} if column.ontology else {}
    name = re.sub(r"_(cm2|cm3|cm|pct)$", "", column.name).replace("_", " ")
    unit = column.scale_name
    return {
        "observationVariableDbId": column.ontology or column.name,
        "observationVariableName": column.name,
        "commonCropName": "Cotton",
        **reference,
        "trait": {"traitDbId": column.name, "traitName": name, "traitDescription": column.description},
        "method": {"methodDbId": METHOD, "methodName": METHOD, "methodClass": "Measurement"},
        "scale": {
            "scaleDbId": unit,
            "scaleName": unit,
            "units": unit,
            "dataType": "Numerical" if column.unit else "Text",
        },
    }


def _observation(field: Field, row: dict[str, Any], column: Column, value: Any, study_id: str) -> dict[str, Any]:
    observation: dict[str, Any] = {
        "observationDbId": f"{study_id}/{row['plant_id']}/{column.name}",
        "observationUnitDbId": row["plant_id"],
        "observationUnitName": row["plant_id"],
        "observationVariableDbId": column.ontology or column.name,
        "observationVariableName": column.name,
        "studyDbId": study_id,
        "value": shown(column, value),
        "uploadedBy": f"cotton3dg {row['version']}",
    }
    if germplasm := field.role(row, "genotype"):
        observation |= {"germplasmDbId": germplasm, "germplasmName": germplasm}
    if date := field.date(row):
        # RFC 3339 requires a time and a zone; without them the text means only the day.
        day, _, time = date.partition("T")
        observation["observationTimeStamp"] = f"{day}T{_full_time(time)}"
    if year := field.role(row, "season"):
        observation["season"] = {"year": int(year)} if year.isdecimal() else {"season": year}
        observation["season"]["seasonDbId"] = year
    return observation


def _full_time(time: str) -> str:
    clock, zone = re.fullmatch(r"([\d:]*)(.*)", time or "00:00:00").groups()  # type: ignore[union-attr]
    return f"{clock if clock.count(':') == 2 else clock + ':00'}{zone or 'Z'}"
