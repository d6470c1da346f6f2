"""Where in space lint is, by the network's probabilities from all views together.

A view errs in the shade, on burs and on pale walls, each view elsewhere. The trained model knows which pixels of
different views show the same thing. Each Gaussian takes the mean probability of the pixels that it is drawn on,
weighted by its part in each, and a rendering of these means brings the evidence of the other views into a view.
(FlashSplat, Shen et al. 2024, votes in this way with masks. Here the votes are probabilities, and no threshold applies
before all views have voted.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float32, Gaussians
from ..gaussians import rasterizer
from .bolls import Maps

LEVELS: Final = 64
"""Steps in which probabilities are counted: the core sums weights by whole numbers."""
EDGE: Final = 0.33
"""Mean probability that separates lint from the rest. It is less than one half because lint may be in the shade in most
views."""
STEEPNESS: Final = 15.0
"""How sharply a Gaussian is lint or not on either side of `EDGE`, 1 / probability."""


@dataclass(frozen=True)
class LintInSpace:
    """A trained model with how much each of its Gaussians is lint."""

    gaussians: Gaussians
    shares: Float32
    """(N,) 0..1"""
    origin: Float32
    """(3,) su, amid the lint: places are rendered relative to it, where single precision is finest."""

    def seen(self, camera: Camera) -> tuple[Float32, Float32]:
        """Share of lint in each pixel (H, W), 0..1, and the mean place of that lint (H, W, 3), su; origin without."""
        local = self.gaussians.means - self.origin
        local[~np.isfinite(local)] = 0
        values = np.column_stack([self.shares, self.shares[:, None] * local]).astype(np.float32)
        image = rasterizer.render_values(self.gaussians, camera, values).image
        share = image[..., 0]
        places = image[..., 1:] / np.maximum(share, np.float32(1e-6))[..., None] + self.origin
        return share, places.astype(np.float32)


def gather_lint(
    maps: Sequence[Maps], cameras: Sequence[Camera], gaussians: Gaussians, allowed: NDArray[np.bool_]
) -> LintInSpace:
    """Gather the probabilities of all views.

    Args:
        allowed: (N,) which Gaussians may be lint at all.
    """
    held, total = np.zeros(len(gaussians)), np.zeros(len(gaussians))
    for view, camera in zip(maps, cameras, strict=True):
        height, width = view.lint.shape
        levels = np.minimum((view.lint * LEVELS).astype(np.uint16), LEVELS - 1) + np.uint16(1)
        weights = rasterizer.accumulate_weights(gaussians, camera.resized(width, height), levels)
        held += np.bincount(weights.rows, weights.weights * ((weights.ids - 0.5) / LEVELS), len(gaussians))
        total += weights.total
    means = held / np.maximum(total, 1e-9)
    shares = (allowed / (1 + np.exp(STEEPNESS * (EDGE - means)))).astype(np.float32)
    lint = gaussians.means[(shares > 0.5) & np.isfinite(gaussians.means).all(axis=1)]
    origin = np.median(lint, axis=0) if len(lint) else np.zeros(3)
    return LintInSpace(gaussians, shares, origin.astype(np.float32))
