"""From bolls in space to masks in one image: the lint in space gives the place, the image's colours give the edges."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float32
from .lint_edges import SHOWN, EdgeNetwork
from .lint_in_space import LintInSpace
from .lint_owners import LintOwners

SURROUNDINGS_PX: Final = 24
"""Width of the surroundings that the network sees."""
SPECK: Final = 9
"""Pixels of the smallest piece of a mask."""


def outline_bolls(
    image: NDArray[np.uint8],
    likely: Float32,
    camera: Camera,
    lint: LintInSpace,
    owners: LintOwners,
    edges: EdgeNetwork,
) -> NDArray[np.uint16]:
    """Masks (H, W) of the bolls in one image (H, W, 3), 1 ... B in the order of the middles, 0 = no lint.

    A network of edges decides which pixels are lint; the middles in space decide to which boll a pixel belongs.

    Args:
        likely: (h, w) probability of lint by this image alone, of any size.
    """
    share, places = lint.seen(camera)
    middles, shown = owners.middles, share > SHOWN
    ids = np.zeros(share.shape, np.uint16)
    if not len(middles.centres) or not shown.any():
        return ids
    left, top, width, height = cv2.boundingRect(shown.astype(np.uint8))
    window = tuple(
        slice(max(low - SURROUNDINGS_PX, 0), low + side + SURROUNDINGS_PX)
        for low, side in ((top, height), (left, width))
    )
    depths = camera.project(middles.centres)[1]
    diameter_px = float(np.median(middles.diameters * camera.fx / np.maximum(depths, 1e-6)))
    whole = cv2.resize(likely, share.shape[::-1], interpolation=cv2.INTER_LINEAR)
    is_lint = np.zeros(share.shape, bool)
    is_lint[window] = edges.find_lint(image[window], share[window], whole[window], diameter_px)
    ids[is_lint] = owners.at(places[is_lint])
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
