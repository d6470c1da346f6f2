# SPDX-License-Identifier: Apache-2.0
"""sRGB: its curve between 0 and 1 (IEC 61966-2-1), and the level at which a photo is burnt out."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .scene import Float32

CLIPPED: Final = 250
"""Grey level, 0..255, from which a channel is saturated."""


def to_linear(srgb: NDArray[Any]) -> Float32:
    """Linear light of sRGB values."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4).astype(np.float32)


def to_srgb(light: NDArray[Any]) -> Float32:
    """sRGB values of linear light."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055).astype(np.float32)
