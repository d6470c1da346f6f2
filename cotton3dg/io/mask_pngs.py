# SPDX-License-Identifier: Apache-2.0
"""Masks that were drawn as PNG files: one grey value or colour per object, or one for all objects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import MaskSet
from ..errors import BadInput
from .images import decode, read_checked

MOST_VALUES: Final = 4096
"""Colours or grey values in one image; a photo has more."""
LEAST_LOOSE: Final = 8
"""At least this many values, and half of all, without connected pixels come from smoothed edges or a photo."""
LEAST_PAIRS: Final = 0.5
"""Neighbours per pixel, to the right and below, with the same value: nearly 2 in an object, few on a smoothed edge."""
OPAQUE: Final = 0.5
"""Share of the highest value at which a pixel counts as drawn, not as transparent or as a smoothed edge."""


def read_mask_pngs(paths: Sequence[Path]) -> MaskSet:
    """Masks by the stem of the file.

    If all images together have only one value, it marks lint and not single bolls: each connected piece of it becomes
    a mask, and `notes` say so.

    Raises:
        BadInput: a file is damaged, a photo, or has smoothed edges.
    """
    drawn = {path.stem: read_drawn_ids(path) for path in paths}
    values = {int(value) for ids in drawn.values() for value in np.unique(ids[ids > 0])}
    if len(values) > 1:
        return MaskSet(drawn)
    pieces = {stem: _pieces(ids) for stem, ids in drawn.items()}
    if all(ids.max(initial=0) <= 1 for ids in pieces.values()):
        return MaskSet(drawn)
    note = (
        "the masks have one value for all bolls, so each connected piece counts as a boll, and bolls that touch count "
        "as one; give each boll of an image a value of its own to count them apart"
    )
    return MaskSet(pieces, notes=(note,))


def read_drawn_ids(path: Path) -> NDArray[np.uint16]:
    """(H, W) ids of a grey, coloured or palette PNG: a value or colour an object, black or transparent = none.

    Raises:
        BadInput: it is damaged, a photo, or has smoothed edges.
    """
    import cv2

    pixels = decode(path, read_checked(path), cv2.IMREAD_UNCHANGED)
    if pixels.dtype not in (np.uint8, np.uint16):
        raise BadInput(f"{path.name} is not a mask; masks are PNG files of 8 or 16 bits, one value an object")
    ids = _without_colours(path, pixels).astype(np.uint16)
    highest = np.iinfo(pixels.dtype).max
    areas, loose = _values(ids)
    smoothed = loose.sum() >= max(LEAST_LOOSE, len(areas) / 2)
    solid = areas[~loose]
    if (smoothed or len(solid) == 1) and 2 * solid.get(highest, 0) > solid.sum():
        return np.where(ids > OPAQUE * highest, np.uint16(highest), np.uint16(0))  # white on black
    if smoothed:
        raise BadInput(
            f"{path.name} has smoothed edges or is a photo, with {loose.sum()} of {len(areas)} values hanging together "
            "nowhere; save masks with one value an object and without smoothing"
        )
    return ids


def _without_colours(path: Path, pixels: NDArray[Any]) -> NDArray[Any]:
    """(H, W) grey values as they are, or the rank of each pixel's colour; 0 where it is transparent."""
    if pixels.ndim == 2:
        return pixels
    values: NDArray[Any] = pixels[..., 0]
    if (pixels[..., :3] != values[..., None]).any():
        found, values = np.unique(
            pixels[..., :3].astype(np.uint64) @ np.array([1, 2**16, 2**32], np.uint64), return_inverse=True
        )
        if len(found) > MOST_VALUES:
            raise BadInput(f"{path.name} is a photo or has smoothed edges; masks have one value or colour an object")
        values = values.reshape(pixels.shape[:2]) + (found[0] > 0)  # black is 0, whether or not the image has any
    if pixels.shape[2] < 4:
        return values
    return np.where(pixels[..., 3] > OPAQUE * np.iinfo(pixels.dtype).max, values, 0)


def _values(ids: NDArray[np.uint16]) -> tuple[Any, Any]:
    """For each value except 0: its area, px, and whether few of its pixels have a neighbour with the same value."""
    import pandas as pd

    alike = [ids[:, 1:][ids[:, 1:] == ids[:, :-1]], ids[1:][ids[1:] == ids[:-1]]]
    areas = pd.Series(np.bincount(ids.ravel(), minlength=1))
    pairs = np.bincount(np.concatenate(alike), minlength=len(areas))
    loose = pairs < LEAST_PAIRS * areas
    there = (areas > 0) & (areas.index > 0)
    return areas[there], loose[there]


def _pieces(ids: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Connected pieces of what is not 0, numbered from 1 on."""
    import cv2

    count, pieces = cv2.connectedComponents((ids > 0).astype(np.uint8))
    if count - 1 > np.iinfo(np.uint16).max:
        raise BadInput(f"a mask has {count - 1} pieces, so it is not a mask of bolls; draw it again")
    numbered: NDArray[np.uint16] = pieces.astype(np.uint16)
    return numbered
