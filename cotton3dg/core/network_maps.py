# SPDX-License-Identifier: Apache-2.0
"""What the bolls' network says of each pixel of an image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene import Float32
from .training_picture import LINT


@dataclass(frozen=True)
class Maps:
    """The network's outputs for each pixel of an image, at half the size of its input."""

    probabilities: Float32
    """(C, h, w) probability of each of `training_picture.CLASSES`."""
    votes: Float32
    """(2, h, w) x and y of the middle of the pixel's boll, px of the image."""
    diameters: Float32
    """(h, w) width of the pixel's boll, px of the image."""
    scale: float
    """Pixels of the image to one of the maps."""
    image_shape: tuple[int, int]

    @property
    def lint(self) -> Float32:
        """(h, w) probability of lint."""
        lint: Float32 = self.probabilities[LINT]
        return lint


def middles_of_pixels(shape: tuple[int, int], scale: float) -> Float32:
    """(2, h, w) x, y of the middles of the pixels of maps, px of the image."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32) + np.float32(0.5)
    return np.stack([x, y]) * np.float32(scale)
