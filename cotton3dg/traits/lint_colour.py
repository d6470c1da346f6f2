# SPDX-License-Identifier: Apache-2.0
"""Colour of the lint, by the grey patches of the plant's card in the same photo.

The patches turn grey levels into reflectances, separately for each channel. This corrects white balance, exposure and
the camera's curve at once. The reflectances hold for a matt surface that lies beside the card. Lint that faces away
from the light, or shades itself, therefore comes out darker than it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.measurements import BollColour, LintColour
from ..core.scene import Float64
from ..core.srgb import CLIPPED

FEWEST_LEVELS: Final = 3
MOST_CLIPPED: Final = 0.05
"""Share of burnt-out pixels from which a view does not count for a boll."""
LEAST_PIXELS: Final = 30
FEWEST_VIEWS: Final = 3
XYZ_OF_SRGB: Final = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
"""IEC 61966-2-1, white D65."""
WHITE_D65: Final = XYZ_OF_SRGB.sum(axis=1)
WHITE_C: Final = np.array([0.98074, 1.0, 1.18232])
BRADFORD: Final = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


@dataclass(frozen=True)
class Calibration:
    """The reflectances of the grey levels of one photo."""

    levels: Float64
    """(L, 3) of the patches, ascending."""
    roots: Float64
    """(L,) reflectances of these to the power 1/2.2; grey levels are nearly proportional to them."""

    def reflectance(self, values: NDArray[Any]) -> Float64:
        """(N, 3) reflectances of (N, 3) grey levels, extrapolated beyond the brightest and the darkest patch."""
        from scipy.interpolate import PchipInterpolator

        found = np.empty(np.shape(values), np.float64)
        for channel in range(3):
            x, y = self.levels[:, channel], self.roots
            level = np.asarray(values[..., channel], np.float64)
            inside = PchipInterpolator(x, y)(np.clip(level, x[0], x[-1]))
            above = (y[-1] - y[-2]) / (x[-1] - x[-2]) * np.maximum(level - x[-1], 0)
            below = (y[1] - y[0]) / (x[1] - x[0]) * np.minimum(level - x[0], 0)
            found[..., channel] = np.maximum(inside + above + below, 0) ** 2.2
        return found


def calibrate(patches: Float64, reflectances: Sequence[float]) -> Calibration | None:
    """The calibration by the patches of a photo; None if too few are usable.

    Args:
        patches: (L, 3) grey levels from white to black, NaN where burnt out. reflectances: of these, 0..1.
    """
    known = np.isfinite(patches).all(axis=1)
    if known.sum() < FEWEST_LEVELS:
        return None
    levels = np.asarray(patches, np.float64)[known][::-1]
    if not (np.diff(levels, axis=0) > 0).all():
        return None
    return Calibration(levels, np.asarray(reflectances, np.float64)[known][::-1] ** (1 / 2.2))


def mask_reflectance(photo: NDArray[np.uint8], mask: NDArray[np.bool_], calibration: Calibration) -> Float64 | None:
    """(3,) mean over the inside of a boll's mask; None where it is too small or burnt out."""
    import cv2

    inside = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    pixels = photo[inside]
    if len(pixels) < LEAST_PIXELS or (pixels >= CLIPPED).any(axis=1).mean() > MOST_CLIPPED:
        return None
    return np.asarray(calibration.reflectance(pixels).mean(axis=0))


def boll_colour(views: Sequence[Float64]) -> BollColour:
    """Colour of a boll from its mean reflectance in each view: the median over the views."""
    if len(views) < FEWEST_VIEWS:
        return BollColour()
    return BollColour(*_figures(np.median(views, axis=0)), lint_colour_views=len(views))


def plant_colour(bolls: Iterable[Sequence[Float64]]) -> LintColour:
    """Mean over the bolls that have a colour."""
    known = [np.median(views, axis=0) for views in bolls if len(views) >= FEWEST_VIEWS]
    return LintColour(*_figures(np.mean(known, axis=0))) if known else LintColour()


def _figures(reflectance: Float64) -> tuple[float, float, float, float, float]:
    lightness, a, b = cielab(reflectance)
    return (float(lightness), float(a), float(b), *reflectance_and_yellowness(reflectance))


def cielab(reflectance: NDArray[Any]) -> Float64:
    """(..., 3) L*, a*, b* (CIE 15) under D65 of linear sRGB reflectances (..., 3)."""
    ratio = np.asarray(reflectance, np.float64) @ XYZ_OF_SRGB.T / WHITE_D65
    root = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def reflectance_and_yellowness(reflectance: NDArray[Any]) -> tuple[float, float]:
    """Rd, %, and +b of cotton grading: Hunter's Rd scale for illuminant C (Hunter 1958), as Nickerson and Hunter's
    colorimeter and HVI instruments show them; from linear sRGB by Bradford's adaptation."""
    xyz = np.asarray(reflectance, np.float64) @ XYZ_OF_SRGB.T
    cones = BRADFORD @ WHITE_C / (BRADFORD @ WHITE_D65)
    _, y, z = np.linalg.inv(BRADFORD) @ (cones * (BRADFORD @ xyz)) / WHITE_C
    rd = 100 * y
    return float(rd), float(70 * 0.51 * (21 + 0.2 * rd) / (1 + 0.2 * rd) * (y - z))
