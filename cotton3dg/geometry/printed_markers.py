# SPDX-License-Identifier: Apache-2.0
"""Printed square markers, ArUco and AprilTag, as OpenCV sees them in a picture."""

from __future__ import annotations

from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64

SMALLEST: Final = 0.02
"""Least length around a marker, in sides of the picture. A marker on the table is seen under a small angle and may be a
few pixels high."""


@cache
def marker_dictionary(name: str) -> Any:
    """OpenCV's dictionary of that name without `DICT_`, e.g. `4x4_50` or `apriltag_36h11`."""
    import cv2

    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name.upper()}"))


def find_squares(grey: NDArray[np.uint8], dictionary: str, *, refined: bool = False) -> dict[int, Float64]:
    """Markers in a (H, W) picture by their number; one that it shows twice is left out.

    Args:
        refined: whether corners are located to a part of a pixel.
    Returns:
        (4, 2) px of the corners of each, in the order of its kind; the corner of the first pixel is (0, 0).
    """
    import cv2

    settings = cv2.aruco.DetectorParameters()
    settings.minMarkerPerimeterRate = SMALLEST
    if refined:
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    quads, ids, _ = cv2.aruco.ArucoDetector(marker_dictionary(dictionary), settings).detectMarkers(grey)
    numbers = [] if ids is None else ids.ravel().tolist()
    # OpenCV counts from the centre of the first pixel.
    return {
        number: quad.reshape(4, 2).astype(np.float64) + 0.5
        for number, quad in zip(numbers, quads, strict=True)
        if numbers.count(number) == 1
    }
