# SPDX-License-Identifier: Apache-2.0
"""What can be said of lint by its colour alone, to compare the bolls' network with."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

SHADE = (0.2, 0.6)
"""Luminance, relative to the image's white, at which lint is impossible and certain."""
CHROMA = (12.0, 22.0)
"""CIELAB chroma at which lint is certain and impossible: cream-coloured lint, colour cast and chroma subsampling."""
PALE = 0.35
"""Largest difference of linear red, green and blue, relative to the largest of them, of what may be white."""
_CODES = np.arange(256) / 255
_LINEAR = np.where(_CODES <= 0.04045, _CODES / 12.92, ((_CODES + 0.055) / 1.055) ** 2.4).astype(np.float32)
"""Linear light of each sRGB code (IEC 61966-2-1)."""


def lint_score(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """How much each pixel's colour is that of lint, 0..1.

    All light is taken relative to the image's own white, the 99.5th percentile of the hardly coloured pixels, so that
    neither exposure nor its drift matters.

    Args:
        image: (H, W, 3) RGB.
    """
    linear = _LINEAR[image]
    luminance = linear @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    brightest = linear.max(axis=2)
    pale = luminance[(brightest - linear.min(axis=2) < PALE * brightest)]
    white = float(np.percentile(pale, 99.5)) if len(pale) else 0.0
    if white <= 0:
        return np.zeros(image.shape[:2], np.float32)
    lab = cv2.cvtColor(np.minimum(linear / np.float32(white), 1), cv2.COLOR_LRGB2LAB)
    chroma = np.hypot(lab[..., 1], lab[..., 2])
    bright = np.clip((luminance / white - SHADE[0]) / (SHADE[1] - SHADE[0]), 0, 1)
    return (bright * np.clip((CHROMA[1] - chroma) / (CHROMA[1] - CHROMA[0]), 0, 1)).astype(np.float32)
