# SPDX-License-Identifier: Apache-2.0
"""Point clouds from scanners: PLY, PCD or plain text, with the boll number of each point if the file has one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.libraries import import_open3d
from ..errors import BadInput, MissingInput
from ..text import read_text

SUFFIXES: Final = (".ply", ".pcd", ".xyz", ".txt", ".csv")
LABELS: Final = ("boll_id", "label", "labels", "scalar_boll_id", "scalar_label", "scalar_labels")
"""Names of a point attribute that numbers the bolls from 1 on, in lower case; CloudCompare puts `scalar_` in front."""
PLACE: Final = ("x", "y", "z")
COMMENT: Final = re.compile(r"//|#")
LARGEST_BOLL_CM: Final = 30.0
"""Largest width of a boll; points with one number that lie farther apart are not one boll."""
MOST_BOLLS: Final = 1000
"""More bolls than any plant bears."""
LEAST_SEEN: Final = 0.5
"""Least share of a cloud's points that have a position; depth cameras also save pixels that they did not see."""


def read_cloud(path: Path, cm_per_unit: float) -> tuple[NDArray[np.float64], NDArray[np.int64] | None]:
    """Points (N, 3) in cm and the boll of each (N,), 0 = none; None if the file does not say.

    Plain text has x y z in its first three columns, or in those of these names, separated by blanks, tabs, commas or
    semicolons; decimal commas are read. The boll is in a column with a name of `LABELS`, or in the fourth and last
    where the columns have no names.

    Raises:
        MissingInput: the file does not exist.
        BadInput: the file cannot be read, has too few points with a position, or other values where boll ids belong.
    """
    if not path.is_file():
        raise MissingInput(f"{path.name} is missing; give a point cloud ({', '.join(SUFFIXES)})")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise BadInput(f"{path.name} is not one of {', '.join(SUFFIXES)}; export the cloud as one of them")
    try:
        points, labels = _read_scanner_file(path) if suffix in (".ply", ".pcd") else _read_text(path)
    except (OSError, ValueError, RuntimeError, IndexError) as error:
        raise BadInput(f"{path.name} cannot be read ({error}); export the cloud again") from error
    finite = np.isfinite(points).all(axis=1)
    if finite.sum() < 4:
        raise BadInput(f"{path.name} has {finite.sum()} points; export the whole plant")
    if finite.mean() < LEAST_SEEN:
        raise BadInput(f"{path.name} has a place for {finite.sum()} of {finite.size} points only; export it again")
    points_cm = points[finite] * cm_per_unit
    return points_cm, None if labels is None else _check_labels(labels[finite], points_cm, path.name)


def _check_labels(labels: NDArray[np.float64], points_cm: NDArray[np.float64], name: str) -> NDArray[np.int64]:
    """The labels as whole numbers.

    Raises:
        BadInput: the values are intensities or the like.
    """
    remedy = "leave that column out, or number the points of each boll from 1 on, 0 being none"
    numbers = np.rint(labels)
    if not np.isfinite(labels).all() or (numbers != labels).any() or (labels < 0).any():
        raise BadInput(f"{name}: the column beside x y z has fractions, so it is not a boll id; {remedy}")
    of_bolls = [points_cm[numbers == number] for number in np.unique(numbers[numbers > 0])[: MOST_BOLLS + 1]]
    across_cm = np.array([np.linalg.norm(np.ptp(own, axis=0)) for own in of_bolls if len(own) > 1])
    if len(of_bolls) > MOST_BOLLS:
        raise BadInput(
            f"{name}: the column beside x y z has over {MOST_BOLLS} numbers, so it is not a boll id; {remedy}"
        )
    if len(across_cm) and np.median(across_cm) > LARGEST_BOLL_CM:
        raise BadInput(
            f"{name}: points that share a number beside x y z lie {np.median(across_cm):.0f} cm apart, so it is "
            f"not a boll id (or --cloud-unit is another); {remedy}"
        )
    return numbers.astype(np.int64)


def _read_scanner_file(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    attributes = import_open3d().t.io.read_point_cloud(path).point
    if "positions" not in attributes:
        return np.zeros((0, 3)), None
    label = next((name for name in attributes if name.lower() in LABELS), None)
    labels = None if label is None else attributes[label].numpy().ravel().astype(np.float64)
    return attributes["positions"].numpy().astype(np.float64), labels


def _read_text(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    lines = [line.strip() for line in read_text(path).split("\n")]
    start, names = _find_start(lines)
    separator, decimal_comma = _layout(lines[start])
    width = len(_split(lines[start], separator))
    body = [line.replace(",", ".") if decimal_comma else line for line in lines[start:] if line]
    try:
        table = np.loadtxt(body, np.float64, comments=None, delimiter=separator, ndmin=2)
    except ValueError:
        table = np.full((1, width), np.nan)
    if not np.isfinite(table).all():
        for number, line in enumerate(lines[start:], start + 1):
            cells = _split(line, separator)
            if line and (len(cells) != width or not _are_numbers(cells, decimal_comma)):
                raise ValueError(f"line {number} is not {width} numbers: {line[:60]!r}")
    if not names:
        return table[:, :3], table[:, 3] if width == len(PLACE) + 1 else None
    named = [axis for axis in PLACE if axis in names]
    if len(named) not in (0, len(PLACE)):
        raise ValueError(f"its columns are {', '.join(names)}, where x, y or z is missing")
    places = [names.index(axis) for axis in named] or [0, 1, 2]
    label = next((place for place, name in enumerate(names) if name in LABELS), None)
    return table[:, places], None if label is None else table[:, label]


def _find_start(lines: list[str]) -> tuple[int, list[str]]:
    """The line where the points begin, and the names of their columns, in lower case, if a line before gives them."""
    names: list[str] = []
    for number, line in enumerate(lines):
        separator, decimal_comma = _layout(line)
        cells = _split(COMMENT.sub("", line, count=1), separator)
        # Some programs write the number of points on a line of its own.
        if len(cells) < len(PLACE):
            continue
        if not COMMENT.match(line) and _are_numbers(cells, decimal_comma):
            return number, names if len(names) == len(cells) else []
        names = [cell.strip('"').lower() for cell in cells]
    raise ValueError("no line of it begins with x y z as numbers")


def _layout(line: str) -> tuple[str | None, bool]:
    """The separator between the cells of a line, None for blanks, and whether its numbers have decimal commas."""
    for separator in (";", "\t"):
        if separator in line:
            return separator, "," in line
    words = line.split()
    if len(words) >= len(PLACE) and not any(word.endswith(",") for word in words):
        return None, "," in line
    return ("," if "," in line else None), False


def _split(line: str, separator: str | None) -> list[str]:
    return [cell.strip() for cell in line.split(separator)]


def _are_numbers(cells: list[str], decimal_comma: bool) -> bool:
    try:
        return all(np.isfinite(float(cell.replace(",", ".") if decimal_comma else cell)) for cell in cells)
    except ValueError:
        return False
