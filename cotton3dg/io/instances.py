# SPDX-License-Identifier: Apache-2.0
"""Instances that a person drew or a tool found in an image, in any of the formats."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import MaskSet
from ..core.scene import Float64
from ..errors import BadInput
from ..text import read_text
from .images import MAX_PIXELS

MAX_JSON_BYTES: Final = 2**28
FARTHEST_PX: Final = 1e5
"""Distance from the image beyond which a corner cannot be a slip of the hand."""
SUBPIXELS: Final = 8


@dataclass(frozen=True)
class Instance:
    """One drawn object."""

    label: str
    """Its class in the file; empty if the file names none."""
    pixels: NDArray[np.int64]
    """(n,) indices into the flattened image."""
    score: float = 1.0


@dataclass(frozen=True)
class AnnotatedImage:
    """Everything that is drawn on one image."""

    height: int
    width: int
    instances: Sequence[Instance]


def read_json(path: Path) -> Any:
    """A JSON document.

    Raises:
        BadInput: the file is empty, too large, or not JSON.
    """
    size = path.stat().st_size
    if not size:
        raise BadInput(f"{path.name} is empty; export it again")
    if size > MAX_JSON_BYTES:
        raise BadInput(f"{path.name} is larger than {MAX_JSON_BYTES >> 20} MiB; export fewer images or as PNG masks")
    try:
        return json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{path.name} is not a whole JSON file; export it again") from error


def check_size(height: int, width: int) -> None:
    """Raises:
    BadInput: an image cannot have this size.
    """
    if not 0 < height * width <= MAX_PIXELS or min(height, width) <= 0:
        raise BadInput(f"an image of {width} x {height} px cannot be; export it again")


def fill_polygons(polygons: Sequence[Any], height: int, width: int) -> NDArray[np.int64]:
    """Indices of the pixels whose centres lie in any of some polygons.

    Args:
        polygons: each x, y of its corners, flat or in pairs, px from the image's corner.
    Raises:
        BadInput: a corner is not a number or lies far outside, or a polygon has fewer than three corners.
    """
    import cv2

    mask = np.zeros((height, width), bool)
    for polygon in polygons:
        corners: Float64 = np.array(polygon, np.float64).reshape(-1, 2)
        if len(corners) < 3:
            raise BadInput(f"a polygon has {len(corners)} corners, it takes 3; draw it again")
        if not np.isfinite(corners).all() or (np.abs(corners) > FARTHEST_PX).any():
            raise BadInput("a polygon has a corner that is not a number or lies far outside; export the file again")
        low = np.clip(np.floor(corners.min(axis=0)), 0, [width, height]).astype(int)
        high = np.clip(np.ceil(corners.max(axis=0)), low, [width, height]).astype(int)
        if (high <= low).any():
            continue
        # OpenCV also fills the outline. On a finer grid, read at the pixels' centres, that makes no difference.
        fine = np.zeros((high - low)[::-1] * SUBPIXELS, np.uint8)
        cv2.fillPoly(fine, [np.round((corners - low) * SUBPIXELS - 0.5).astype(np.int32)], 1)
        centres = fine[SUBPIXELS // 2 :: SUBPIXELS, SUBPIXELS // 2 :: SUBPIXELS].astype(bool)
        mask[low[1] : high[1], low[0] : high[0]] |= centres
    return np.flatnonzero(mask)


def parse_score(value: Any) -> float:
    """A confidence as a number in 0..1; anything else counts as 0."""
    score = float(value)
    return min(max(score, 0.0), 1.0) if math.isfinite(score) else 0.0


def paint_all(images: Mapping[str, AnnotatedImage], classes: Collection[str], source: str) -> MaskSet:
    """Masks by image; where instances overlap, the smaller one is in front.

    Args:
        images: by the stem of the file name. classes: labels that are bolls; none = the only one there is.
        source: name for messages.
    Raises:
        BadInput: there are several classes and none was chosen, or a chosen class does not exist.
    """
    labels = {instance.label for image in images.values() for instance in image.instances} - {""}
    listed = ", ".join(sorted(labels)[:8])
    missing = sorted(set(classes) - labels)
    if labels and missing:
        raise BadInput(f"{source} has no class {missing[0]!r}; it has {listed}")
    if len(labels) > 1 and not classes:
        raise BadInput(f"{source} has {len(labels)} classes ({listed}); say which are bolls with --classes")
    kept = {
        stem: [item for item in image.instances if not classes or item.label in classes]
        for stem, image in images.items()
    }
    outlined = sum(len(item.pixels) > 0 for items in kept.values() for item in items)
    boxes = sum(map(len, kept.values())) - outlined
    if boxes and not outlined:
        raise BadInput(f"{source}: none of {boxes} instances has an outline; draw outlines, boxes alone are not masks")
    note = f"{boxes} of {boxes + outlined} instances of {source} have no outline and are left out; draw theirs too"
    masks = MaskSet({}, {}, notes=(note,) if boxes else ())
    for stem, image in images.items():
        try:
            masks.ids[stem], masks.scores[stem] = paint(kept[stem], image.height, image.width)
        except BadInput as error:
            raise BadInput(f"{source}: {error}") from error
    return masks


def paint(instances: Sequence[Instance], height: int, width: int) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """One image's (H, W) ids, 1 ... in the order of the instances, and their scores."""
    if len(instances) > np.iinfo(np.uint16).max:
        raise BadInput(f"{len(instances)} instances in one image do not fit into 16 bits; leave some out")
    ids = np.zeros(height * width, np.uint16)
    for index in np.argsort([-len(item.pixels) for item in instances], kind="stable"):
        ids[instances[index].pixels] = index + 1
    scores = {number: instances[number - 1].score for number in np.unique(ids[ids > 0]).tolist()}
    return ids.reshape(height, width), scores


def trace_outlines(mask: NDArray[np.bool_], tolerance_px: float) -> list[Float64]:
    """Outer borders of a mask's pieces, each (n, 2) x, y of corners in px from the image's corner.

    Holes are not outlined. The border is moved by at most `tolerance_px` to have fewer corners, as a person draws.
    """
    import cv2

    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return []
    top, left, finer = int(rows[0]), int(columns[0]), 4
    crop = mask[top : rows[-1] + 1, left : columns[-1] + 1].astype(np.uint8)
    # OpenCV traces the centres of border pixels; finer pixels bring them to within 1/8 px of the border itself.
    fine = crop.repeat(finer, 0).repeat(finer, 1)
    found, _ = cv2.findContours(fine, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    polygons = [cv2.approxPolyDP(border, tolerance_px * finer, True)[:, 0] for border in found]
    return [(corners + 0.5) / finer + (left, top) for corners in polygons if len(corners) >= 3]
