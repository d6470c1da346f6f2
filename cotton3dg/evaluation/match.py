# SPDX-License-Identifier: Apache-2.0
"""One-to-one matching of bolls by their centres, as tests and the evaluation need it."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

MATCH_DISTANCE_CM: Final = 3.0
"""A boll matches another one if their centres are no farther apart."""


def match_bolls(centres_a: NDArray[Any], centres_b: NDArray[Any], max_distance: float) -> NDArray[np.int64]:
    """The most pairs of centres no farther apart than `max_distance`, and among such sets the nearest on the whole.

    Args:
        centres_a, centres_b: (A, 3) and (B, 3) in one unit; rows with NaN match nothing.
        max_distance: same unit.
    Returns:
        (n, 2) rows of a and of b, ascending by a; Hungarian assignment.
    """
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    a, b = np.reshape(centres_a, (-1, 3)).astype(np.float64), np.reshape(centres_b, (-1, 3)).astype(np.float64)
    distances = cdist(a, b)
    near = distances <= max_distance
    # A pair that is too far apart costs more than all others together could save, so it never replaces a near pair.
    costs = np.where(near, distances, (len(a) + len(b) + 1) * (max_distance + 1))
    rows, columns = linear_sum_assignment(costs)
    kept = near[rows, columns]
    return np.stack([rows[kept], columns[kept]], axis=1)
