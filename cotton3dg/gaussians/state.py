# SPDX-License-Identifier: Apache-2.0
"""The state that a training keeps between steps besides the Gaussians, and the sizes of its steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32, Gaussians

BANDS: Final = 4
"""Degrees of the spherical harmonics, 0 to 3."""


def arrays_of(gaussians: Gaussians) -> tuple[Float32, Float32, Float32, Float32, Float32]:
    """The arrays in the order in which the core takes them."""
    g = gaussians
    return g.means, g.quats, g.log_scales, g.opacity_logits, g.sh


@dataclass(frozen=True)
class LearningRates:
    """Step sizes of Adam and its constants; `means` is in su."""

    means: float
    quats: float
    log_scales: float
    opacity_logits: float
    sh0: float
    sh_rest: float
    beta1: float = 0.9
    beta2: float = 0.999
    epsilon: float = 1e-15


@dataclass
class AdamState:
    """Moments of the gradient. Every Gaussian counts its own steps, since it is updated only in views that show it, and
    every band of its colour, since the higher ones join later."""

    first: Gaussians
    second: Gaussians
    steps: NDArray[np.int32]
    """(N, BANDS) updates so far; the first band's are those of the geometry, too."""

    @staticmethod
    def zeros(gaussians: Gaussians) -> AdamState:
        """The state before the first step."""
        first, second = (Gaussians(*(np.zeros_like(a) for a in arrays_of(gaussians))) for _ in range(2))
        return AdamState(first, second, np.zeros((len(gaussians), BANDS), np.int32))

    def carried_over(self, rows: NDArray[np.int64], continued: NDArray[np.bool_]) -> AdamState:
        """The state of the Gaussians at `rows`, those that are not `continued` at zero."""
        state = AdamState(self.first[rows], self.second[rows], self.steps[rows])
        for array in (*arrays_of(state.first), *arrays_of(state.second), state.steps):
            array[~continued] = 0
        return state


@dataclass
class DensityStatistics:
    """Sums over training views for density control. A view counts for the Gaussians that have weight in it."""

    abs_grad_px: Float32
    """(N,) length of the sum of absolute per-pixel gradients by the projected mean (AbsGS), in the units of Kerbl et
    al.: per px times half the image size."""
    weight: Float32
    """(N,) blending weight, as a share of the image."""
    count: NDArray[np.int32]
    """(N,) views."""

    @staticmethod
    def zeros(count: int) -> DensityStatistics:
        """Nothing seen yet."""
        abs_grad_px, weight = np.zeros((2, count), np.float32)
        return DensityStatistics(abs_grad_px, weight, np.zeros(count, np.int32))
