"""scale_points.csv: two points of known distance, picked by hand in several images."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import BadInput
from .tables import read_rows

COLUMNS: Final = ("point", "image", "x_px", "y_px")


def read_picks(path: Path) -> dict[str, dict[str, NDArray[np.float64]]]:
    """Point -> image -> (2,) px.

    A row a pick: the point's name, the image's file name in sfm/undistorted/images, and column and row of the pixel as
    image viewers show them, 0 being the first; its centre is taken.

    Raises:
        BadInput: a column is missing, a number cannot be read, or a point was picked twice in an image.
    """
    picks: dict[str, dict[str, NDArray[np.float64]]] = {}
    for line, row in enumerate(read_rows(path), 2):
        if missing := [column for column in COLUMNS if not row.get(column)]:
            raise BadInput(f"{path.name}, line {line}: no {', '.join(missing)}; give {', '.join(COLUMNS)}")
        try:
            place = np.array([float(row["x_px"]), float(row["y_px"])]) + 0.5
        except ValueError as error:
            raise BadInput(f"{path.name}, line {line}: {error}; write pixels as numbers with a dot") from error
        images = picks.setdefault(row["point"].strip(), {})
        image = row["image"].strip()
        if image in images or not np.isfinite(place).all():
            raise BadInput(
                f"{path.name}, line {line}: {row['point']} in {image} is there twice or not finite; keep one"
            )
        images[image] = place
    return picks
