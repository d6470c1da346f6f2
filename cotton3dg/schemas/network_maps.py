# SPDX-License-Identifier: Apache-2.0
"""masks/<image>.npz: the bolls' network's maps of one image, rounded.

Probabilities have 8 bits and form one grey PNG, class below class. Votes and diameters have half precision, in pixels
of the maps; only pixels that may be lint have them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import cv2
import numpy as np

from ..core.network_maps import Maps, middles_of_pixels
from ..core.training_picture import CLASSES
from ..errors import BadInput
from ..io.arrays import read_arrays

MAY_BE_LINT: Final = 0.1
"""Probability of lint from which a pixel keeps its vote; nothing uses the votes of less likely ones."""
_LEVELS: Final = 255
_FAST: Final = (cv2.IMWRITE_PNG_COMPRESSION, 1)


def write_maps(path: Path, maps: Maps) -> None:
    """Save the maps of an image."""
    levels = np.rint(maps.probabilities * _LEVELS).astype(np.uint8)
    ways = (maps.votes - middles_of_pixels(maps.lint.shape, maps.scale)) / np.float32(maps.scale)
    voting = maps.lint > MAY_BE_LINT
    with path.open("wb") as file:
        np.savez(
            file,
            probabilities=cv2.imencode(".png", levels.reshape(-1, levels.shape[2]), _FAST)[1].ravel(),
            voting=np.packbits(voting),
            ways=ways[:, voting].astype(np.float16),
            diameters=(maps.diameters[voting] / np.float32(maps.scale)).astype(np.float16),
            scale=np.array(maps.scale, np.float64),
            image_shape=np.array(maps.image_shape, np.int64),
        )


def read_maps(path: Path) -> Maps:
    """The maps that `write_maps` saved. A pixel without a vote votes for itself.

    Raises:
        BadInput: it is not such a file, or its arrays do not belong together.
    """
    arrays = read_arrays(path)
    try:
        stacked = cv2.imdecode(arrays["probabilities"], cv2.IMREAD_GRAYSCALE)
        if stacked is None:
            raise ValueError("no PNG of probabilities")
        levels = stacked.reshape(len(CLASSES), -1, stacked.shape[1])
        shape, scale = levels.shape[1:], float(arrays["scale"])
        voting = np.unpackbits(arrays["voting"], count=shape[0] * shape[1]).astype(bool).reshape(shape)
        votes, diameters = middles_of_pixels(shape, scale), np.full(shape, scale, np.float32)
        votes[:, voting] += arrays["ways"].astype(np.float32) * np.float32(scale)
        diameters[voting] = arrays["diameters"].astype(np.float32) * np.float32(scale)
        height, width = (int(side) for side in arrays["image_shape"])
    except (KeyError, ValueError, TypeError, IndexError, cv2.error) as error:
        raise BadInput(f"{path.name} is damaged ({error}); make it again with `cotton3dg masks --force`") from error
    return Maps((levels / np.float32(_LEVELS)).astype(np.float32), votes, diameters, scale, (height, width))
