"""Prompts for SAM that a person clicked: a CSV table of points or boxes, a row a boll."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from ..core.scene import Float64
from ..errors import BadInput, MissingInput

POINT, BOX = ("x", "y"), ("x1", "y1", "x2", "y2")


def read_prompts(path: Path) -> dict[str, Float64]:
    """Points (n, 2) or boxes (n, 4) by the stem of the image's file name, px of the undistorted image.

    The table's first line is image,x,y or image,x1,y1,x2,y2.

    Raises:
        MissingInput: no such file. BadInput: not such a table.
    """
    if not path.is_file():
        raise MissingInput(f"{path} is not there; give a table of points or boxes as --prompts, or none")
    rows: dict[str, list[list[float]]] = {}
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            table = csv.DictReader(file)
            heading = set(table.fieldnames or [])
            columns = next((names for names in (BOX, POINT) if {"image", *names} <= heading), None)
            if columns is None:
                raise BadInput(
                    f"{path.name} needs the columns image,x,y or image,x1,y1,x2,y2; name them in its first line"
                )
            for number, row in enumerate(table, start=2):
                values = [float(row[name]) for name in columns]
                if not all(map(math.isfinite, values)) or (columns == BOX and not _is_box(values)):
                    wanted = "a box, x1 < x2 and y1 < y2" if columns == BOX else "a point, x and y"
                    raise BadInput(f"{path.name}, line {number}: {values} is not {wanted}; correct it")
                rows.setdefault(Path(str(row["image"]).replace("\\", "/")).stem, []).append(values)
    except (ValueError, TypeError, csv.Error) as error:
        raise BadInput(f"{path.name} is no table of numbers ({error!r:.80}); save it as CSV") from error
    if not rows:
        raise BadInput(f"{path.name} holds no prompt; add a line for each boll")
    return {stem: np.array(values, np.float64) for stem, values in rows.items()}


def _is_box(values: list[float]) -> bool:
    return values[0] < values[2] and values[1] < values[3]
