"""Point clouds of scanners: PLY, PCD or plain text, with the number of each point's boll where somebody gave it."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.libraries import import_open3d
from ..errors import BadInput, MissingInput

SUFFIXES: Final = (".ply", ".pcd", ".xyz", ".txt", ".csv")
LABELS: Final = ("boll_id", "label", "labels", "scalar_boll_id", "scalar_label", "scalar_Label")
"""Names of a point attribute that numbers the bolls from 1 on; CloudCompare puts `scalar_` in front."""


def read_cloud(path: Path, cm_per_unit: float) -> tuple[NDArray[np.float64], NDArray[np.int64] | None]:
    """Points (N, 3) in cm and the boll of each (N,), 0 = none; None where the file does not tell.

    Plain text has x y z in the first three columns, separated by blanks, commas or semicolons, and may have the boll in
    a last, fourth one; a first line that is no number is a header.

    Raises:
        MissingInput: there is no such file.
        BadInput: the file cannot be read or has fewer than 4 finite points.
    """
    if not path.is_file():
        raise MissingInput(f"{path.name} is missing; give a point cloud ({', '.join(SUFFIXES)})")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise BadInput(f"{path.name} is no {', '.join(SUFFIXES)}; export the cloud as one of them")
    try:
        points, labels = _read_scanner_file(path) if suffix in (".ply", ".pcd") else _read_text(path)
    except (OSError, ValueError, RuntimeError, IndexError) as error:
        raise BadInput(f"{path.name} cannot be read ({error}); export the cloud again") from error
    finite = np.isfinite(points).all(axis=1)
    if finite.sum() < 4:
        raise BadInput(f"{path.name} has {finite.sum()} points; export the whole plant")
    return points[finite] * cm_per_unit, None if labels is None else labels[finite]


def _read_scanner_file(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64] | None]:
    attributes = import_open3d().t.io.read_point_cloud(path).point
    if "positions" not in attributes:
        return np.zeros((0, 3)), None
    label = next((name for name in LABELS if name in attributes), None)
    labels = None if label is None else np.rint(attributes[label].numpy().ravel()).astype(np.int64)
    return attributes["positions"].numpy().astype(np.float64), labels


def _read_text(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64] | None]:
    lines = path.read_text(encoding="utf-8-sig").replace(",", " ").replace(";", " ").splitlines()
    try:
        [float(cell) for cell in lines[0].split()]
    except ValueError:
        lines = lines[1:]
    table = np.loadtxt(lines, dtype=np.float64, ndmin=2)
    return table[:, :3], np.rint(table[:, 3]).astype(np.int64) if table.shape[1] == 4 else None
