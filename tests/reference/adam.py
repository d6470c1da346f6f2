# SPDX-License-Identifier: Apache-2.0
"""The optimiser of cotton3dg once more, in plain float64 numpy: what native/src/adam.h computes."""

from __future__ import annotations

import numpy as np

from cotton3dg.gaussians.state import LearningRates

LONGEST_GRADIENT = 1e15


def adam(
    parameter: np.ndarray,
    gradient: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    steps: np.ndarray,
    rate: np.ndarray,
    rates: LearningRates,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameter, first and second moment (N, ...) after a step; `steps` counts it.

    `steps` and `rate` are (N, ...) or (N,).
    """

    def spread(rows: np.ndarray) -> np.ndarray:
        return rows if rows.ndim == parameter.ndim else rows.reshape((-1,) + (1,) * (parameter.ndim - 1))

    g = np.clip(gradient, -LONGEST_GRADIENT, LONGEST_GRADIENT)
    first = rates.beta1 * first + (1 - rates.beta1) * g
    second = rates.beta2 * second + (1 - rates.beta2) * g**2
    unbiased = first / (1 - rates.beta1 ** spread(steps))
    scale = np.sqrt(second / (1 - rates.beta2 ** spread(steps))) + rates.epsilon
    return parameter - spread(rate) * unbiased / scale, first, second
