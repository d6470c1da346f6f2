# SPDX-License-Identifier: Apache-2.0
"""scale_points.csv: two points of known distance, picked by hand in several images."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import BadInput
from .spreadsheet import read_table

COLUMNS: Final = ("point", "image", "x_px", "y_px")


def read_picks(path: Path) -> dict[str, dict[str, NDArray[np.float64]]]:
    """Point -> image -> (2,) px.

    Each row is a pick: the point's name, the image's file name in sfm/undistorted/images, and column and row of the
    pixel as image viewers show them, 0 being the first; the pick is its centre.

    Raises:
        BadInput: a column is missing, a number cannot be read, or a point was picked twice in an image.
    """
    picks: dict[str, dict[str, NDArray[np.float64]]] = {}
    table = read_table(path)
    table.require(*COLUMNS)
    places = np.stack([table.numbers("x_px"), table.numbers("y_px")], 1) + 0.5
    for line, row, place in zip(table.lines, table.rows, places, strict=True):
        if missing := [column for column in COLUMNS if not row[column].strip()]:
            raise BadInput(f"{path.name}, row {line}: no {', '.join(missing)}; give {', '.join(COLUMNS)}")
        images = picks.setdefault(row["point"].strip(), {})
        image = row["image"].strip()
        if image in images or not np.isfinite(place).all():
            raise BadInput(f"{path.name}, row {line}: {row['point']} in {image} is there twice or nowhere; keep one")
        images[image] = place
    return picks
