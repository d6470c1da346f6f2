# SPDX-License-Identifier: Apache-2.0
"""Finds open bolls in a single image, without a model that combines several images."""

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
"""If leaf covers more than this share of an image, other things may look like lint: bracts, flowers, shine. All of 100
images of living cotton without open bolls had more leaf."""
EVIDENCE: Final = 1.5
"""Such an image shows bolls only if their evidence (`weigh_evidence`) is at least this. One of the 100 images had more;
of 160 photographs of open cotton, none with so much leaf had less."""
MOST_OF_ONE: Final = 1.5
"""Most evidence of one boll, in discs of its predicted size: the network may underestimate its size."""


def find_bolls(image: NDArray[np.uint8], network: BollNetwork) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Masks of the bolls in one image; none if it shows leaves and too little evidence of open bolls.

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
    """Evidence of an image for open bolls: the sum over its bolls of the square of the part that is surely seen.

    A boll that is seen whole and without a doubt counts 1. By the square a few clear bolls outweigh many faint ones.

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
