# SPDX-License-Identifier: Apache-2.0
"""Reads a plant's printed card in photos: the scale by its markers, and the grey levels of its patches.

All markers of a card make one rigid body: the scale comes from distances of up to 30 cm between their corners. The
patches give the white balance and the exposure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.card import (
    MARKER_CM,
    MARKER_DICTIONARY,
    MARKERS_CM,
    PATCH_LEVELS,
    PATCHES_CM,
    RULER_CM,
    marker_corner_cm,
)
from ..core.scene import Camera, Float64
from ..core.srgb import CLIPPED
from .markers import Corner, MarkerFit, MarkerKind, fit_bodies
from .references import NoReference

CARD_MARKERS: Final = MarkerKind(MARKER_DICTIONARY, MARKER_CM)
LEAST_MARKERS: Final = 2
INNER: Final = 0.55
"""Share of a patch's sides that is measured, because its rim is blurred."""
LEAST_PX: Final = 4.0
"""Least height of a patch in the photo."""
PLACES: Final = 9
"""Number of places along a side of a patch."""
DARKER: Final = 2.0
"""Least difference in grey levels between a patch and the brighter one before it. With less, something lies on the
card."""


def scale_from_card(
    cameras: Sequence[Camera], found: Sequence[Mapping[Corner, Float64]], ruler_cm: float = RULER_CM
) -> MarkerFit | NoReference:
    """The scale at which the card has its known size.

    Args:
        found: what `find_markers` found of `CARD_MARKERS` in the photo of each camera.
        ruler_cm: length of the printed ruler as measured; printers scale.
    """
    own = [{corner: place for corner, place in corners.items() if corner[1] in MARKERS_CM} for corners in found]
    if not any(own):
        return NoReference("no photo shows a card")
    stretch = ruler_cm / RULER_CM
    return fit_bodies(
        cameras,
        own,
        lambda corner: stretch * np.array(marker_corner_cm(corner[1], corner[2])),
        lambda corner: "card",
        "card",
    )


def read_patches(photo: NDArray[np.uint8], corners: Mapping[Corner, Float64]) -> Float64 | None:
    """(6, 3) RGB, 0..255, of the card's levels from white to black; a burnt-out level is NaN.

    Both columns of patches count alike. They have the levels in opposite order, so light that falls off evenly across
    the card is the same, on average, for every level.

    Args:
        photo: (H, W, 3).
        corners: the card's markers in the photo, as `find_markers` finds them.
    Returns:
        None where the photo does not show the card well enough: fewer than two markers, too aslant or too far, or half
        covered.
    """
    import cv2

    own = [corner for corner in corners if corner[1] in MARKERS_CM]
    if len({corner[1] for corner in own}) < LEAST_MARKERS:
        return None
    flat = np.array([marker_corner_cm(corner[1], corner[2]) for corner in own])
    homography, _ = cv2.findHomography(flat, np.array([corners[corner] for corner in own]))
    if homography is None:
        return None
    lefts, top, width, height = PATCHES_CM
    within = 0.5 + INNER * (np.arange(PLACES) / (PLACES - 1) - 0.5)
    columns = []
    for left, order in zip(lefts, (range(len(PATCH_LEVELS)), reversed(range(len(PATCH_LEVELS)))), strict=True):
        levels = []
        for row in order:
            x, y = np.meshgrid(left + width * within, top + height * (row + within))
            seen = cv2.perspectiveTransform(np.stack([x, y], axis=-1).reshape(1, -1, 2), homography)[0]
            grid = seen.reshape(PLACES, PLACES, 2)
            if _height_px(grid) < LEAST_PX or not _inside(seen, photo.shape):
                return None
            # The first pixel's centre is at 0.5, for OpenCV at 0.
            at = (grid - 0.5).astype(np.float32)
            levels.append(cv2.remap(photo, at, None, cv2.INTER_LINEAR).reshape(-1, 3))
        columns.append(levels)
    values = np.array([[np.median(patch, axis=0) for patch in levels] for levels in columns], np.float64)
    brightest = np.array([[np.percentile(patch, 90) for patch in levels] for levels in columns])
    burnt = brightest.max(axis=0) >= CLIPPED
    # Light adds up, grey levels do not. For the mean of two near levels an approximate tone curve suffices.
    mean = (values**2.2).mean(axis=0) ** (1 / 2.2)
    if not (np.diff(mean, axis=0) <= -DARKER).all(where=~burnt[:-1, None]):
        return None
    return np.where(burnt[:, None], np.nan, mean)


def _height_px(grid: Float64) -> float:
    """Height of a whole patch, px, from its inner places."""
    return float(np.linalg.norm(grid[-1] - grid[0], axis=1).min() / INNER)


def _inside(places: Float64, shape: tuple[int, ...]) -> bool:
    return bool((places >= 0).all() and (places[:, 0] < shape[1]).all() and (places[:, 1] < shape[0]).all())
