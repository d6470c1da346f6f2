# SPDX-License-Identifier: Apache-2.0
"""The layout of the printed card of a plant, cm from its top left corner, x to the right, y down."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .srgb import to_linear

DOTS_PER_CM: Final = 100
"""Of a printed sheet."""
PAPER_CM: Final = {"a4": (21.0, 29.7), "letter": (21.59, 27.94)}
WIDTH_CM: Final = 18.6
HEIGHT_CM: Final = 25.9
"""Width and height of the print, with the ruler; A4 and Letter leave a margin around it."""
MARKER_DICTIONARY: Final = "4x4_100"
MARKER_CM: Final = 4.8
MARKERS_CM: Final = {96: (0.0, 0.0), 97: (13.8, 0.0), 98: (13.8, 20.0), 99: (0.0, 20.0)}
"""Number of a marker -> its top left corner. Loose markers have others: `cotton3dg markers` prints those of 4x4_50."""
CODE_CM: Final = (4.1, 5.9, 10.4)
"""Left and top of the code, and its side."""
PATCHES_CM: Final = ((0.0, 15.7), 5.9, 2.9, 1.73)
"""Left of both columns, top, width and height of a patch."""
PATCH_LEVELS: Final = (255, 205, 155, 105, 55, 0)
"""Grey levels of the left column from the top. The right column has them from below, which shows light that falls
off."""
RULER_CM: Final = 10.0
INK: Final = 0.04
PAPER: Final = 0.86
"""Reflectance of black toner and of office paper."""


def printed_reflectance(levels: NDArray[Any]) -> NDArray[np.float32]:
    """Reflectance of printed grey levels, 0..255, as a printer that keeps to sRGB makes them."""
    return np.float32(INK) + np.float32(PAPER - INK) * to_linear(np.asarray(levels, np.float32) / 255)


def marker_corner_cm(number: int, corner: int) -> tuple[float, float]:
    """Place of a corner of a marker, counted from its top left one clockwise."""
    x, y = MARKERS_CM[number]
    right, down = ((0, 0), (1, 0), (1, 1), (0, 1))[corner]
    return x + MARKER_CM * right, y + MARKER_CM * down
