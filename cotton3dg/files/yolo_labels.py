"""YOLO segmentation labels: a text file an image, a line an instance: class, then x y of its corners in shares of the
image's width and height (https://docs.ultralytics.com/datasets/segment). A file without lines is an image without any.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import BadInput
from .instances import AnnotatedImage, Instance, check_size, fill_polygons, trace_outlines

BOX_COLUMNS: Final = 5
TOLERANCE_PX: Final = 0.5


def read_yolo_labels(path: Path, height: int, width: int, names: list[str]) -> AnnotatedImage:
    """The instances of one image.

    Args:
        height, width: of the image. names: of the classes, by their number; without one, the number is the name.
    Raises:
        BadInput: a line that is no outline.
    """
    check_size(height, width)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise BadInput(f"{path.name} is no text; export the labels again") from error
    instances = []
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words:
            continue
        where = f"{path.name}, line {number}"
        if len(words) == BOX_COLUMNS:
            raise BadInput(f"{where} is a box, not an outline; export segmentation labels")
        try:
            values, label = np.array([float(word) for word in words[1:]]), int(words[0])
            # A last, odd number is the confidence of a prediction.
            score = float(values[-1]) if len(values) % 2 else 1.0
            corners = values[: len(values) // 2 * 2].reshape(-1, 2)
            if label < 0 or not np.isfinite(values).all() or (np.abs(corners - 0.5) > 1).any():
                raise ValueError(line[:40])
        except ValueError as error:
            raise BadInput(
                f"{where} is not a class and x y in shares of the image's size; export the labels again"
            ) from error
        try:
            pixels = fill_polygons([corners * (width, height)], height, width)
        except BadInput as error:
            raise BadInput(f"{where}: {error}") from error
        name = names[label] if label < len(names) else str(label)
        instances.append(Instance(name, pixels, min(max(score, 0.0), 1.0)))
    return AnnotatedImage(height, width, instances)


def write_yolo_labels(path: Path, ids: NDArray[np.uint16]) -> None:
    """Save instance ids (H, W) as class 0; of an instance in several pieces the outlines are joined by a seam.

    As a line holds one outline, the pieces follow one another and each returns to where the first began.
    """
    height, width = ids.shape
    lines = []
    for value in np.unique(ids[ids > 0]).tolist():
        polygons = trace_outlines(ids == value, TOLERANCE_PX)
        if polygons:
            start = polygons[0][:1]
            chain = [np.concatenate([corners, corners[:1], start]) for corners in polygons]
            shares = np.concatenate(chain if len(chain) > 1 else polygons) / (width, height)
            lines.append("0 " + " ".join(f"{share:.6f}" for share in shares.ravel()))
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
