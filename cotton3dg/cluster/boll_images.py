# SPDX-License-Identifier: Apache-2.0
"""The bolls drawn into the images: which pixels of a view show which boll."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera
from .label_gaussians import LintOwners
from .lint_in_space import LintInSpace

SHOWN: Final = 0.5
"""A pixel shows lint if its rendered share of lint is more than this."""
SPECK: Final = 9
"""Least number of pixels of a piece of a boll in an image."""


def draw_bolls(camera: Camera, lint: LintInSpace, owners: LintOwners) -> NDArray[np.uint16]:
    """(H, W) ids of the bolls in a view: 1 ... B in the order of the middles, 0 = no lint."""
    share, places = lint.seen(camera)
    shown = share > SHOWN
    ids = np.zeros(share.shape, np.uint16)
    ids[shown] = owners.at(places[shown])
    return without_specks(ids)


def without_specks(ids: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """`ids` without pieces of fewer than `SPECK` pixels."""
    from scipy import ndimage

    kept = ids.copy()
    for boll, box in enumerate(ndimage.find_objects(ids), start=1):
        if box is not None:
            own = (ids[box] == boll).astype(np.uint8)
            _, pieces, facts, _ = cv2.connectedComponentsWithStats(own, connectivity=8)
            small = facts[:, cv2.CC_STAT_AREA] < SPECK
            kept[box][small[pieces] & (own > 0)] = 0
    return kept
