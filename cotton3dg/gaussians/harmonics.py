# SPDX-License-Identifier: Apache-2.0
"""Real spherical harmonics of degree 0 to 3 with the signs and constants of Kerbl et al. 2023, and turning them."""

from __future__ import annotations

import numpy as np

from ..core.scene import SH_CONSTANT, Float32, Float64
from ..geometry.boxes import fibonacci_directions


def basis(directions: Float64, n_coefficients: int) -> Float64:
    """(N, K) the first K = 1, 4, 9 or 16 functions at (N, 3) unit vectors, as native/src/harmonics.h has them."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    functions = [
        np.full_like(x, SH_CONSTANT),
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2 * zz - xx - yy),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4 * zz - xx - yy),
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457994644658 * x * (4 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3 * yy),
    ]
    return np.stack(functions[:n_coefficients], axis=1)


def rotate_harmonics(sh: Float32, rotation: Float64) -> Float32:
    """(N, K, 3) coefficients in a frame x of the colour that (N, K, 3) coefficients have in the frame `rotation` @ x.

    Functions of one degree turn into each other, so their values at turned directions are a linear map of those at the
    given ones. The map is solved for at more directions than there are functions.
    """
    directions = fibonacci_directions(64)
    count = sh.shape[1]
    turn = np.linalg.lstsq(
        basis(directions, count), basis(directions @ np.asarray(rotation, np.float64).T, count), rcond=None
    )[0]
    return np.ascontiguousarray(np.einsum("jk,nkc->njc", turn, sh), dtype=np.float32)
