# SPDX-License-Identifier: Apache-2.0
"""High-dynamic-range video to ordinary sRGB images."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

PQ: Final = "smpte2084"
HLG: Final = "arib-std-b67"
"""ffmpeg's names of the two transfer functions of ITU-R BT.2100."""
REFERENCE_WHITE_NITS: Final = 203.0
"""Diffuse white of HDR video (ITU-R BT.2408)."""

# ITU-R BT.2087: linear BT.2020 to linear BT.709.
_BT709_FROM_BT2020: Final = np.array(
    [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]], np.float32
)


def tone_map(rgb: NDArray[np.uint16], transfer: str) -> NDArray[np.uint8]:
    """Map full-range BT.2020 PQ or HLG video to sRGB.

    Light is scaled so that diffuse white becomes 1, its primaries are converted, and a pixel whose largest component
    exceeds 0.8 is scaled down as a whole, which keeps its hue. The same curve serves all frames, so that a point keeps
    its colour along the video.

    Args:
        rgb: (H, W, 3) non-linear, 16 bits full range.
        transfer: `PQ` or `HLG`.
    Returns:
        (H, W, 3)
    """
    import cv2

    light = np.take(_linear_table(transfer), rgb)
    light = np.maximum(cv2.transform(light, _BT709_FROM_BT2020), 0.0)
    peak = light.max(axis=2, keepdims=True)
    light *= _compress(peak) / np.maximum(peak, 1e-6)
    levels: NDArray[np.uint8] = np.take(_srgb_table(), np.minimum(light * 65535.0 + 0.5, 65535.0).astype(np.uint16))
    return levels


def _compress(peak: NDArray[np.float32]) -> NDArray[np.float32]:
    """Identity up to 0.8; above it a rational curve of slope 1 there that approaches 1."""
    knee = np.float32(0.8)
    over = np.maximum(peak - knee, 0.0) / (1.0 - knee)
    compressed: NDArray[np.float32] = np.minimum(peak, knee) + (1.0 - knee) * over / (1.0 + over)
    return compressed


@cache
def _linear_table(transfer: str) -> NDArray[np.float32]:
    """(65536,) light relative to diffuse white of each 16-bit code value (ITU-R BT.2100-2, tables 4 and 5)."""
    v = np.linspace(0.0, 1.0, 65536)
    if transfer == PQ:
        m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
        p = v ** (1 / m2)
        nits = 10000.0 * (np.maximum(p - c1, 0.0) / (c2 - c3 * p)) ** (1 / m1)
        return (nits / REFERENCE_WHITE_NITS).astype(np.float32)
    if transfer == HLG:
        a, b, c = 0.17883277, 0.28466892, 0.55991073
        scene = np.where(v <= 0.5, v**2 / 3, (np.exp((v - c) / a) + b) / 12)
        # Diffuse white sits at 75 % signal. The display's gamma of 1.2 is applied per channel here.
        white = (np.exp((0.75 - c) / a) + b) / 12
        table: NDArray[np.float32] = ((scene / white) ** 1.2).astype(np.float32)
        return table
    raise ValueError(f"unknown transfer function {transfer!r}")


@cache
def _srgb_table() -> NDArray[np.uint8]:
    """(65536,) sRGB code value of linear light."""
    v = np.linspace(0.0, 1.0, 65536)
    encoded = np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)
    return np.round(encoded * 255).astype(np.uint8)
