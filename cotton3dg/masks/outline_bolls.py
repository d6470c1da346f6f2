"""From bolls in space to masks in one image: the lint in space says where, the image's colours where it ends."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera
from .graph_cut import cut_groups
from .lint_in_space import LintInSpace
from .lint_owners import LintOwners
from .paint_bolls import nearest_silhouettes, without_specks

SURELY, POSSIBLY = 0.8, 0.15
"""Shares of lint, rendered, of a pixel that is lint whatever its colour, and of one that may be."""
SURROUNDINGS = 0.3
"""Width, in diameters of the bolls, of what shows the colours that are no lint."""
SHOWN = 0.05
"""Least share of lint in a pixel whose lint has a place."""


def outline_bolls(
    image: NDArray[np.uint8], camera: Camera, lint: LintInSpace, owners: LintOwners
) -> NDArray[np.uint16]:
    """Masks (H, W) of the bolls in one image (H, W, 3), 1 ... B in the order of the middles, 0 = no lint.

    A minimum cut (GrabCut, Rother et al. 2004) between the colours of what surely is lint and of what surely is none
    moves the edges of the rendered lint to those of the image; which boll it is, is decided in space.
    """
    share, places = lint.seen(camera)
    middles = owners.middles
    ids = np.zeros(share.shape, np.uint16)
    if not len(middles.centres) or not (share > POSSIBLY).any():
        return ids
    ids[share > SHOWN] = owners.at(places[share > SHOWN])
    depths = camera.project(middles.centres)[1]
    diameter_px = float(np.median(middles.diameters * camera.fx / np.maximum(depths, 1e-6)))
    trimap = np.where(share > 0.5, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    trimap[(share > SURELY) & (ids > 0)] = cv2.GC_FGD
    trimap[(share < POSSIBLY) | ((share > SHOWN) & (ids == 0))] = cv2.GC_BGD
    within = share > POSSIBLY
    cut = cut_groups(image, trimap, within, max(round(SURROUNDINGS * diameter_px), 3))
    return without_specks(np.where(cut, nearest_silhouettes(ids), 0).astype(np.uint16))
