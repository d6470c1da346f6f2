"""The optimiser of cotton3dg once more, in plain float64 numpy: what native/src/adam.h computes."""

from __future__ import annotations

import numpy as np

from cotton3dg.gaussians.state import LearningRates

LONGEST_GRADIENT = 1e15


def rates_of_rows(rates: LearningRates, means: np.ndarray, name: str) -> np.ndarray:
    """(N,) rate of the array `name` for Gaussians at `means` (N, 3)."""
    far = rates.surroundings
    beyond = np.linalg.norm(means - np.array(far.centre), axis=1) / far.radius_su - 1
    longer = 1 + far.growth * np.maximum(0, beyond)
    if name == "means":
        return rates.means * np.minimum(longer, far.most_means)
    if name == "log_scales":
        return rates.log_scales * np.minimum(longer, far.most_log_scales)
    return np.full(len(means), getattr(rates, name))


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
