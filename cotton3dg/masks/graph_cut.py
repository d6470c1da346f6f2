"""Where lint ends, by the colours of an image: GrabCut (Rother et al. 2004) around each group of bolls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

ITERATIONS: Final = 2
"""Rounds of GrabCut; more change hardly a pixel."""
FEWEST: Final = 20
"""Pixels, of lint and of surroundings, that a colour model of five Gaussians takes."""

Window = tuple[slice, slice]


def cut_groups(
    image: NDArray[np.uint8],
    trimap: NDArray[np.uint8],
    within: NDArray[np.bool_],
    margin_px: int,
    shown: Callable[[Window], NDArray[np.uint8]] | None = None,
) -> NDArray[np.bool_]:
    """Which pixels (H, W) are foreground.

    Bolls that are close share colour models and a cut, so that no boll is in the surroundings of another.

    Args:
        trimap: (H, W) OpenCV's GC_FGD, GC_PR_FGD, GC_PR_BGD, GC_BGD.
        within: (H, W) pixels that may be foreground; connected ones are a group.
        margin_px: width of the surroundings that are cut with each group.
        shown: gives the colours that the cut uses in a window; None = the image's.
    """
    import cv2

    found = np.zeros(trimap.shape, bool)
    _, groups, boxes, _ = cv2.connectedComponentsWithStats(within.astype(np.uint8))
    for group, (left, top, width, height, _) in enumerate(boxes[1:], start=1):
        rows = slice(max(top - margin_px, 0), top + height + margin_px)
        window = rows, slice(max(left - margin_px, 0), left + width + margin_px)
        cut = trimap[window].copy()
        begun = (cut == cv2.GC_FGD) | (cut == cv2.GC_PR_FGD)
        if min(begun.sum(), (~begun).sum()) >= FEWEST:
            cv2.setRNGSeed(0)  # GrabCut begins its models with a random k-means
            colours = image[window] if shown is None else shown(window)
            models = np.zeros((1, 65)), np.zeros((1, 65))
            cv2.grabCut(np.ascontiguousarray(colours), cut, None, *models, ITERATIONS, cv2.GC_INIT_WITH_MASK)
            begun = (cut == cv2.GC_FGD) | (cut == cv2.GC_PR_FGD)
        found[window] |= begun & (groups[window] == group)
    return found
