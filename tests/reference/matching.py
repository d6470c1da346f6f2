# SPDX-License-Identifier: Apache-2.0
"""The matching of descriptors once more, in plain numpy: all products, sorted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def best_two(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.int64]:
    """(3, N) for each row of a: the largest product with a row of b, the next one, and the first row that has the
    largest; -1 = none."""
    products = np.full((len(a), len(b) + 2), -1, np.int64)
    products[:, : len(b)] = a.astype(np.int64) @ b.astype(np.int64).T
    ordered = np.sort(products, axis=1)
    index = products.argmax(axis=1) if len(b) else np.full(len(a), -1)
    return np.stack([ordered[:, -1], ordered[:, -2], index])
