# SPDX-License-Identifier: Apache-2.0
"""Changes of light and colour that occur in photographs, but not in renderings; they teach a network to use shapes.

Simulated pictures share a renderer's light and palette. Sunlight that falls through leaves, other white balances, other
tone curves and other sharpness keep the network from relying on them (Buslaev et al. 2020 list such transforms).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from ..core.scene import Float32
from ..core.training_picture import TrainingPicture

DAPPLED: Final = 0.35
"""Share of the pictures under a smooth random field of brightness, ..."""
COLOURED: Final = 0.6
"""... with another saturation and hue, ..."""
TONED: Final = 0.55
"""... with another gamma, gain and contrast, ..."""
RESHARPENED: Final = 0.15
"""... blurred or sharpened."""
CONTRAST: Final = (-0.35, 0.25)
GAIN: Final = (-0.5, 0.3)
"""Natural logarithms, least and most."""
LUMA: Final = np.array([0.299, 0.587, 0.114], np.float32)


def augment(rng: np.random.Generator, picture: TrainingPicture) -> TrainingPicture:
    """The picture with its light and colours changed at random; shapes and labels stay."""
    image: Float32 = picture.image.astype(np.float32) / np.float32(255)
    if rng.random() < DAPPLED:
        image *= _dapples(rng, image.shape[0], image.shape[1])[..., None]
    if rng.random() < COLOURED:
        image = _recolour(rng, image)
    if rng.random() < TONED:
        image = np.power(image.clip(0, 1), np.exp(rng.uniform(-0.5, 0.5)), dtype=np.float32)
        contrast, gain = (np.float32(np.exp(rng.uniform(*range_))) for range_ in (CONTRAST, GAIN))
        middle = image.mean()
        image = gain * (middle + contrast * (image - middle))
    if rng.random() < RESHARPENED:
        soft = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.6, 2.0)))
        image = soft if rng.random() < 0.5 else image + np.float32(rng.uniform(0.5, 2.5)) * (image - soft)
    return replace(picture, image=np.round(255 * image.clip(0, 1)).astype(np.uint8))


def _dapples(rng: np.random.Generator, height: int, width: int) -> Float32:
    """(H, W) factors from shade to sun, as soft or as sharp as spots of light on the ground."""
    cells = int(rng.integers(2, 14))
    coarse = rng.normal(0, 1, (cells, cells)).astype(np.float32)
    field = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    lit = 1 / (1 + np.exp(-rng.uniform(1, 8) * (field - rng.normal(0, 0.5))))
    shade = rng.uniform(0.15, 0.8)
    dapples: Float32 = (shade + (rng.uniform(1.0, 1.4) - shade) * lit).astype(np.float32)
    return dapples


def _recolour(rng: np.random.Generator, image: Float32) -> Float32:
    """Another saturation, and the colours turned a little about grey."""
    grey = (image @ LUMA)[..., None]
    turn, saturation = rng.normal(0, 0.1), rng.uniform(0.2, 1.9)
    # Rodrigues' rotation about the axis of greys.
    cos, sin = np.cos(turn), np.sin(turn) / np.sqrt(3)
    third = (1 - cos) / 3
    rotation = np.array(
        [
            [cos + third, third - sin, third + sin],
            [third + sin, cos + third, third - sin],
            [third - sin, third + sin, cos + third],
        ],
        np.float32,
    )
    return grey + np.float32(saturation) * ((image - grey) @ rotation.T)
