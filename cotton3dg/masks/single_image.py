# SPDX-License-Identifier: Apache-2.0
"""Open bolls in one image alone, where no model of the plant combines the evidence of several images."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.network_maps import Maps
from ..core.training_picture import LEAF
from .bolls import BollNetwork
from .group_votes import group_votes
from .test_time_augmentation import predict_with_augmentation

IN_LEAF: Final = 0.02
"""Share of an image's pixels that are leaf from which much may only look like lint: bracts, flowers, shine. All of 100
images of living cotton without open bolls had more."""
EVIDENCE: Final = 1.5
"""Least evidence of all bolls of such an image (`weigh_evidence`); with less it shows none. Of these 100 images one had
more, of 160 photographs of open cotton none with so much leaf had less."""
MOST_OF_ONE: Final = 1.5
"""Most evidence of one boll, in its own discs: a boll may be larger than the network takes it for."""


def find_bolls(image: NDArray[np.uint8], network: BollNetwork) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Masks of the bolls in one image; none if it shows leaves and nothing that surely is an open boll.

    Args:
        image: (H, W, 3) sRGB.
    Returns:
        ids (H, W), 1 ... B from the surest on, 0 = no lint; and each boll's score.
    """
    maps = predict_with_augmentation(image, network)
    ids, scores = group_votes(maps)
    in_leaf = (maps.probabilities[LEAF] > 0.5).mean() > IN_LEAF
    if in_leaf and weigh_evidence(ids, maps) < EVIDENCE:
        return np.zeros_like(ids), {}
    return ids, scores


def weigh_evidence(ids: NDArray[np.uint16], maps: Maps) -> float:
    """Evidence of an image for open bolls: the sum over its bolls of the square of the part that is surely seen,
    which is 1 for a boll seen whole without a doubt. Thanks to the square a few clear bolls outweigh many faint ones.

    Args:
        ids: (H, W) of the image.
    """
    small = cv2.resize(ids, maps.lint.shape[::-1], interpolation=cv2.INTER_NEAREST)
    total = 0.0
    for boll in np.unique(small[small > 0]):
        own = small == boll
        disc_px = np.pi / 4 * (float(np.median(maps.diameters[own])) / maps.scale) ** 2
        total += min(float(maps.lint[own].sum()) / disc_px, MOST_OF_ONE) ** 2
    return total
