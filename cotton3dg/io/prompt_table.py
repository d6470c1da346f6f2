# SPDX-License-Identifier: Apache-2.0
"""Prompts for SAM that a person clicked: a CSV table of points or boxes, one row per boll."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from ..core.scene import Float64
from ..errors import BadInput, MissingInput
from .spreadsheet import read_table

POINT: Final = ("x", "y")
BOX: Final = ("x1", "y1", "x2", "y2")


def read_prompts(path: Path) -> dict[str, Float64]:
    """Points (n, 2) or boxes (n, 4) by the stem of the image's file name, px of the undistorted image.

    The table's first line is image,x,y or image,x1,y1,x2,y2.

    Raises:
        MissingInput: the file does not exist. BadInput: it is not such a table.
    """
    if not path.is_file():
        raise MissingInput(f"{path} is not there; give a table of points or boxes as --prompts, or none")
    table = read_table(path)
    if not table.rows:
        raise BadInput(f"{path.name} holds no prompt; add a line for each boll")
    columns = next((names for names in (BOX, POINT) if {"image", *names} <= {*table.columns}), None)
    if columns is None:
        raise BadInput(f"{path.name} needs the columns image,x,y or image,x1,y1,x2,y2; name them in its first line")
    prompts: dict[str, list[Float64]] = {}
    places = np.stack([table.numbers(name) for name in columns], 1)
    for line, row, place in zip(table.lines, table.rows, places, strict=True):
        if not np.isfinite(place).all() or (columns == BOX and not (place[:2] < place[2:]).all()):
            wanted = "a box, x1 < x2 and y1 < y2" if columns == BOX else "a point, x and y"
            cells = ", ".join(row[name] for name in columns)
            raise BadInput(f"{path.name}, row {line}: {cells} is not {wanted}; correct it")
        prompts.setdefault(Path(row["image"].strip().replace("\\", "/")).stem, []).append(place)
    return {stem: np.array(values, np.float64) for stem, values in prompts.items()}
