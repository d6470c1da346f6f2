"""CSV tables that a spreadsheet opens: RFC 4180, comma and dot, ASCII headers with units, blank where not measured."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

BYTE_ORDER_MARK = "\ufeff"


@dataclass(frozen=True)
class Column:
    """One column of a table and what `columns.csv` says about it."""

    name: str
    unit: str
    description: str
    digits: int | None = None
    """Digits after the dot; None for text and integers."""
    ontology: str = ""
    """Crop Ontology term."""


TRAITS = (
    Column("plant_id", "", "name of the plant: option traits.plant_id, else the folder's name"),
    Column("boll_count", "1", "open bolls found", ontology="CO_358:0001327"),
    Column("boll_volume_cm3", "cm3", "sum of volume_cm3 over the measured bolls", 2),
    Column("boll_volume_mean_cm3", "cm3", "mean of volume_cm3 over the measured bolls", 2),
    Column("plant_height_cm", "cm", "99.9th percentile of the plant's height above the table top", 2, "CO_358:0001138"),
    Column(
        "plant_height_obb_cm", "cm", "upright side of the plant's oriented bounding box, which leans with the plant", 2
    ),
    Column("canopy_size_cm", "cm", "mean of canopy_length_cm and canopy_width_cm", 2),
    Column("canopy_length_cm", "cm", "long side of the least-area rectangle around the plant seen from above", 2),
    Column("canopy_width_cm", "cm", "short side of the least-area rectangle around the plant seen from above", 2),
    Column("scale_source", "", "reference of known size; none = no metric trait is given"),
    Column("scale_error_pct", "%", "estimated standard error of lengths; volumes have three times as much", 3),
    Column("n_frames", "1", "images taken from the video"),
    Column("registered_pct", "%", "share of the images that structure from motion could place", 1),
    Column("psnr_db", "dB", "likeness of rendered and held-out images", 2),
    Column("seconds", "s", "computing time of all stages", 1),
    Column("qc_flags", "", "quality flags of all stages, separated by semicolons"),
    Column("version", "", "version of cotton3dg"),
    Column("plant_hull_volume_cm3", "cm3", "volume of the convex hull of the plant and its foot", 1),
    Column("boll_height_mean_cm", "cm", "mean height of the bolls' centres above the table top", 2),
    Column("boll_height_sd_cm", "cm", "standard deviation of the heights of the bolls' centres", 2),
    Column("boll_height_min_cm", "cm", "height of the lowest boll's centre above the table top", 2),
    Column("boll_height_max_cm", "cm", "height of the highest boll's centre above the table top", 2),
    Column("bolls_lower", "1", "bolls with their centre in the lower third of plant_height_cm"),
    Column("bolls_middle", "1", "bolls with their centre in the middle third of plant_height_cm"),
    Column("bolls_upper", "1", "bolls with their centre in the upper third of plant_height_cm"),
    Column("lint_area_cm2", "cm2", "sum of projected_area_cm2 over the measured bolls", 2),
    Column("boll_count_error", "1", "standard error of boll_count, were each boll's confidence its probability", 2),
    Column("boll_volume_error_cm3", "cm3", "standard error of boll_volume_cm3, of scale and view support", 2),
    Column("plant_height_error_cm", "cm", "standard error of plant_height_cm, of the scale and a pixel", 2),
    Column("canopy_size_error_cm", "cm", "standard error of canopy_size_cm, of the scale and a pixel", 2),
)

BOLLS = (
    Column("plant_id", "", "name of the plant"),
    Column("boll_id", "", "number of the boll in this plant"),
    Column("x_cm", "cm", "centre along the table's long side, from the foot of the stem", 2),
    Column("y_cm", "cm", "centre along the table's short side, from the foot of the stem", 2),
    Column("z_cm", "cm", "height of the centre above the table top", 2),
    Column("volume_cm3", "cm3", "volume of the convex body that the boll's silhouettes bound", 2),
    Column("alpha_volume_cm3", "cm3", "volume a ball of a quarter of the diameter cannot enter from outside", 2),
    Column("diameter_cm", "cm", "mean calliper width of that convex body", 2),
    Column("n_gaussians", "1", "Gaussians of the boll"),
    Column("n_views", "1", "views whose masks agree on the boll"),
    Column("confidence", "1", "share of the views that see the boll and agree on it", 3),
    Column("qc_flags", "", "quality flags of the boll, separated by semicolons"),
    Column("volume_error_cm3", "cm3", "standard error of volume_cm3, of scale and view support", 2),
    Column("projected_area_cm2", "cm2", "area of the shadow of that convex body, mean over all directions", 2),
)

COLUMNS = (
    Column("table", "", "file that has the column"),
    Column("column", "", "header of the column"),
    Column("unit", "", "unit of its values"),
    Column("description", "", "what is measured and how"),
    Column("crop_ontology", "", "term of the Crop Ontology where one exists"),
)


def csv_text(columns: Sequence[Column], rows: Iterable[Mapping[str, Any]], *, excel: bool = False) -> str:
    """A table as text; write it in binary or with `newline=""`, its lines end in CR LF.

    NaN and None become blank cells; lists of flags are joined by semicolons. Text that a spreadsheet would take for a
    formula is prefixed with an apostrophe (CWE-1236); numbers never are.

    Args:
        excel: put a byte-order mark in front so that Excel reads UTF-8.
    Raises:
        KeyError: a row lacks a column.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\r\n")
    writer.writerow([column.name for column in columns])
    writer.writerows([[_cell(row[column.name], column.digits) for column in columns] for row in rows])
    return (BYTE_ORDER_MARK if excel else "") + text.getvalue()


def columns_text(tables: Mapping[str, Sequence[Column]], *, excel: bool = False) -> str:
    """`columns.csv`: a row for each column of each of `tables` (file name -> columns)."""
    rows = [
        {"table": table, "column": c.name, "unit": c.unit, "description": c.description, "crop_ontology": c.ontology}
        for table, columns in tables.items()
        for c in columns
    ]
    return csv_text(COLUMNS, rows, excel=excel)


def _cell(value: Any, digits: int | None) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return _harmless(value)
    if isinstance(value, (list, tuple)):
        return _harmless(";".join(str(item) for item in value))
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float):
        if not math.isfinite(value):
            return ""
        # Adding 0 turns -0.00 into 0.00.
        return f"{round(value, digits) + 0.0:.{digits}f}" if digits is not None else repr(value)
    return str(value)


def _harmless(text: str) -> str:
    """`text` as a spreadsheet shows it instead of computing it."""
    text = text.replace("\0", "")
    return "'" + text if text.lstrip().startswith(("=", "+", "-", "@")) or text[:1] in ("\t", "\r") else text
