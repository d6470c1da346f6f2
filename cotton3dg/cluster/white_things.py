# SPDX-License-Identifier: Apache-2.0
"""Finds white things that are not open bolls: closed bolls, and cloths, balls and mugs near the plant.

The network is less sure of them than of the plant's open bolls, and it sees no bur, wood or leaf beside things that do
not grow on a plant.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.network_maps import Maps
from ..core.scene import Float32, Float64
from ..core.training_picture import LINT, OTHER
from ..geometry.point_sets import weighted_median

BESIDE: Final = 0.3
"""Width of the surroundings of a boll, relative to the root of its area in the image."""
LITTLE: Final = 0.12
ENOUGH: Final = 0.25
"""Limits of the probability of a plant beside a boll. Values outside are clipped: below the lower one there is no
plant, above the upper one there surely is."""
LESS: Final = 0.06
"""A thing is not a boll if the sum of its probabilities, of lint and of a plant beside it, is this much below the usual
one of lint. Bolls that lie half in the shade are up to 0.045 below."""
SILENT: Final = 0.05
"""A network that usually sees less than this of a plant beside bolls does not know plants, e.g. because it learnt from
other pictures. Then only the probability of lint counts."""
FEWEST: Final = 12
"""Least number of a boll's pixels in the maps of an image for its surroundings to be measured there."""


def measure_surroundings(maps: Maps, ids: NDArray[np.uint16], bolls: int) -> Float64:
    """The network's probabilities on and beside each boll in one image.

    Args:
        ids: (H, W) of the image, 1 ... `bolls`, 0 = no lint.
    Returns:
        (B, 4) sums: probability of lint on it, its pixels, probability of bur, wood or leaf beside it, those pixels.
    """
    from scipy import ndimage

    height, width = maps.lint.shape
    small = cv2.resize(ids, (width, height), interpolation=cv2.INTER_NEAREST)
    plant = 1 - maps.probabilities[OTHER] - maps.probabilities[LINT]
    sums = np.zeros((bolls, 4))
    for number, box in enumerate(ndimage.find_objects(small, bolls)):
        if box is None:
            continue
        pixels = int((small[box] == number + 1).sum())
        if pixels < FEWEST:
            continue
        margin = max(int(BESIDE * np.sqrt(pixels)), 2)
        around = tuple(slice(max(side.start - margin, 0), side.stop + margin) for side in box)
        own = small[around] == number + 1
        beside = cv2.dilate(own.astype(np.uint8), np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)) > 0
        beside &= small[around] == 0
        sums[number] = maps.lint[around][own].sum(), pixels, plant[around][beside].sum(), beside.sum()
    return sums


def find_white_things(sums: Float64, support: Float32) -> NDArray[np.bool_]:
    """(B,) which of the bolls are not bolls.

    The sum of their probability of lint and of a plant beside them (within limits) is clearly below the usual
    probability of lint.

    Args:
        sums: (B, 4) of `measure_surroundings`, over all images.
        support: (B,) how much of each is seen.
    """
    lint, plant = sums[:, [0, 2]].T / np.maximum(sums[:, [1, 3]].T, 1)
    shown = sums[:, 1] > 0
    if not shown.any():
        return shown
    usual, usual_plant = (weighted_median(means[shown], support[shown]) for means in (lint, plant))
    beside = plant.clip(LITTLE, ENOUGH) if usual_plant > SILENT else np.full(len(plant), ENOUGH)
    white: NDArray[np.bool_] = shown & (lint + beside < usual - LESS)
    return white
