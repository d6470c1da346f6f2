# SPDX-License-Identifier: Apache-2.0
"""Makes training pictures from annotated photos: pieces at many sizes, mirrored, brightened, blurred."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.training_picture import LINT, NOT_LINT, TrainingPicture

ZOOM: Final = (0.7, 1.5)
LEAST_PX: Final = 9


@dataclass(frozen=True)
class AnnotatedPhoto:
    image: NDArray[np.uint8]
    """(H, W, 3) sRGB, as large as the network is to see it."""
    ids: NDArray[np.uint16]
    """(H, W) number of the boll, 0 = none."""


def cut_picture(rng: np.random.Generator, photos: Sequence[AnnotatedPhoto], size: int) -> TrainingPicture:
    """A square piece of one of the photos; more often than not around a boll.

    The middle of a boll is that of its mask's box, because an annotation holds nothing else about the boll.
    """
    photo = photos[int(rng.integers(len(photos)))]
    height, width = photo.ids.shape
    rows, columns = np.nonzero(photo.ids)
    middle = rng.uniform(0, 1, 2) * (width, height)
    if len(rows) and rng.random() < 0.8:
        pick = int(rng.integers(len(rows)))
        middle = np.array([columns[pick], rows[pick]], float)
    zoom = np.exp(rng.uniform(*np.log(ZOOM)))
    turn = rng.normal(0, 0.15)
    mirror = rng.choice([-1.0, 1.0])
    matrix = zoom * np.array([[np.cos(turn) * mirror, -np.sin(turn)], [np.sin(turn) * mirror, np.cos(turn)]])
    offset = 0.5 * size + rng.uniform(-0.3, 0.3, 2) * size - matrix @ middle
    affine = np.column_stack([matrix, offset])
    image = cv2.warpAffine(photo.image, affine, (size, size), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
    ids = cv2.warpAffine(photo.ids, affine, (size, size), flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_REFLECT_101)
    numbers, ids = np.unique(ids, return_inverse=True)
    ids = ids.reshape(size, size).astype(np.uint16) + np.uint16(numbers[0] != 0)
    centres, diameters = _boxes(ids)
    classes = np.where(ids > 0, LINT, NOT_LINT).astype(np.uint8)
    return TrainingPicture(_vary(rng, image), classes, ids, centres, diameters)


def _boxes(ids: NDArray[np.uint16]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Middles (B, 2) and sizes (B,), px, of the boxes around the masks 1 ... B."""
    from scipy import ndimage

    centres, diameters = [], []
    for box in ndimage.find_objects(ids, max_label=int(ids.max())):
        rows, columns = box if box is not None else (slice(0, LEAST_PX), slice(0, LEAST_PX))
        centres.append((0.5 * (columns.start + columns.stop), 0.5 * (rows.start + rows.stop)))
        diameters.append(np.sqrt((columns.stop - columns.start) * (rows.stop - rows.start)))
    return np.array(centres, np.float32).reshape(-1, 2), np.array(diameters, np.float32)


def _vary(rng: np.random.Generator, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Another exposure and white balance, noise, and at times blur."""
    gains = np.exp(rng.normal(0, 0.25) + rng.normal(0, 0.05, 3))
    varied = (
        255 * (image.astype(np.float32) / 255) ** np.float32(np.exp(rng.normal(0, 0.15))) * gains.astype(np.float32)
    )
    if rng.random() < 0.3:
        varied = cv2.GaussianBlur(varied, (0, 0), float(rng.uniform(0.4, 1.5)))
    varied += np.float32(rng.uniform(0, 5)) * rng.standard_normal(varied.shape, np.float32)
    return np.ascontiguousarray(np.round(varied.clip(0, 255)).astype(np.uint8))
