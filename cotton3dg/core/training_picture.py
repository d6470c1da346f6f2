# SPDX-License-Identifier: Apache-2.0
"""The pictures from which a network of bolls learns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

UNKNOWN: Final = 255
"""Class of pixels that teach nothing, e.g. lint too blurred to be counted."""
NOT_LINT: Final = 254
"""Class of pixels that an annotation only excludes from lint."""
CLASSES: Final = ("other", "lint", "bur", "wood", "leaf")
OTHER: Final = 0
LINT: Final = 1
LEAF: Final = 4


@dataclass(frozen=True)
class TrainingPicture:
    """An image with the classes and bolls of its pixels."""

    image: NDArray[np.uint8]
    """(H, W, 3) sRGB."""
    classes: NDArray[np.uint8]
    """(H, W) index into `CLASSES`, or `UNKNOWN` or `NOT_LINT`."""
    ids: NDArray[np.uint16]
    """(H, W) boll whose lint is seen, 1 ... B; 0 = none."""
    centres_px: NDArray[np.float32]
    """(B, 2) x, y of the middle of boll b + 1, seen or not."""
    diameters_px: NDArray[np.float32]
    """(B,) its width."""
