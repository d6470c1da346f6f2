# SPDX-License-Identifier: Apache-2.0
"""How much each Gaussian is lint, by the network's probabilities from all views together.

The network errs in the shade, on burs and on pale walls, but at other places in each view. The trained model knows
which pixels of different views show the same thing. Each Gaussian takes the mean probability of the pixels that it is
drawn on, weighted by its part in each. (FlashSplat, Shen et al. 2024, votes in this way with masks. Here the votes are
probabilities, and no threshold applies before all views have voted.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.network_maps import Maps
from ..core.runs import Progress, silent
from ..core.scene import Camera, Float32, Float64, Gaussians
from ..gaussians.rasterizer import accumulate_weights

LEVELS: Final = 64
"""Number of steps of a probability, because the core sums weights by whole numbers."""
EDGE: Final = 0.4
"""Mean probability that separates lint from the rest. It is less than one half because lint may be in the shade in most
views. By the area of lint that the images show, the best edge of thirteen simulated plants lies between 0.37 and 0.58;
above 0.4 the volumes become too small (docs/notes/same_boll.md)."""
STEEPNESS: Final = 15.0
"""Steepness of the share of lint at `EDGE`, 1 / probability."""


def gather_lint(
    maps: Sequence[Maps],
    cameras: Sequence[Camera],
    gaussians: Gaussians,
    allowed: NDArray[np.bool_],
    progress: Progress = silent,
) -> Float32:
    """(N,) share of lint of each Gaussian, 0..1, by the probabilities of all views.

    Args:
        maps: of the image of each of `cameras`.
        allowed: (N,) which Gaussians may be lint at all.
    """
    means = average_lint(maps, cameras, gaussians, progress)
    shares: Float32 = (allowed / (1 + np.exp(STEEPNESS * (EDGE - means)))).astype(np.float32)
    return shares


def average_lint(
    maps: Sequence[Maps], cameras: Sequence[Camera], gaussians: Gaussians, progress: Progress = silent
) -> Float64:
    """(N,) mean probability of lint of the pixels that each Gaussian is drawn on, weighted by its part in each.

    Args:
        maps: of the image of each of `cameras`.
    """
    held, total = np.zeros(len(gaussians)), np.zeros(len(gaussians))
    for done, (view, camera) in enumerate(zip(maps, cameras, strict=True)):
        progress(done, len(cameras), camera.name)
        height, width = view.lint.shape
        levels = np.minimum((view.lint * LEVELS).astype(np.uint16), LEVELS - 1) + np.uint16(1)
        weights = accumulate_weights(gaussians, camera.resized(width, height), levels)
        held += np.bincount(weights.rows, weights.weights * ((weights.ids - 0.5) / LEVELS), len(gaussians))
        total += weights.total
    return held / np.maximum(total, 1e-9)
