# SPDX-License-Identifier: Apache-2.0
"""Labelme annotations, one JSON file per image: https://github.com/wkentaro/labelme."""

from __future__ import annotations

import base64
import binascii
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BadInput
from .instances import AnnotatedImage, Instance, check_size, fill_polygons


def is_labelme(document: Any) -> bool:
    return isinstance(document, dict) and "shapes" in document


def parse_labelme(document: Any, path: Path) -> tuple[str, AnnotatedImage]:
    """Stem of the image, and what is drawn on it; shapes of one group are one instance.

    Raises:
        BadInput: the document is damaged, or a shape is not an area.
    """
    try:
        height, width = int(document["imageHeight"]), int(document["imageWidth"])
        check_size(height, width)
        groups: dict[Any, list[tuple[str, NDArray[np.int64]]]] = {}
        for number, shape in enumerate(document["shapes"]):
            group = shape.get("group_id")
            key = ("shape", number) if group is None else (str(shape["label"]), group)
            groups.setdefault(key, []).append((str(shape["label"]), _fill_shape(shape, height, width)))
        instances = [
            Instance(pieces[0][0], np.unique(np.concatenate([pixels for _, pixels in pieces])))
            for pieces in groups.values()
        ]
        stem = Path(str(document.get("imagePath") or path.name).replace("\\", "/")).stem
        return stem, AnnotatedImage(height, width, instances)
    except BadInput as error:
        raise BadInput(f"{path.name}: {error}") from error
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError) as error:
        raise BadInput(f"{path.name} is not a whole Labelme file ({error!r:.80}); save it again") from error


def _fill_shape(shape: dict[str, Any], height: int, width: int) -> NDArray[np.int64]:
    kind, points = shape.get("shape_type") or "polygon", shape["points"]
    if kind == "polygon":
        return fill_polygons([points], height, width)
    if kind == "mask":
        return _paste(shape["mask"], points, height, width)
    raise BadInput(f"the shape {shape['label']!r} is a {kind}, not an outline; draw bolls as polygons or masks")


def _paste(encoded: str, points: Any, height: int, width: int) -> NDArray[np.int64]:
    """Pixels of a mask, saved as a PNG in base64, whose first and last pixel lie at two points."""
    import cv2

    try:
        content = np.frombuffer(base64.b64decode(encoded, validate=True), np.uint8)
        crop = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if len(content) else None
    except (binascii.Error, cv2.error) as error:
        raise BadInput("a mask is damaged; save it again") from error
    left, top = (round(float(value)) for value in points[0])
    if crop is None or crop.ndim != 2:
        raise BadInput("a mask is damaged; save it again")
    if left < 0 or top < 0 or top + crop.shape[0] > height or left + crop.shape[1] > width:
        raise BadInput("a mask reaches out of its image; save it again")
    mask = np.zeros((height, width), bool)
    mask[top : top + crop.shape[0], left : left + crop.shape[1]] = crop > 0
    return np.flatnonzero(mask)
