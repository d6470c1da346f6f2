"""The Gaussians that training starts from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Gaussians
from ..errors import BadInput
from ..options import TrainOptions
from .dense import dense_points
from .views import View

SH_CONSTANT = 0.28209479177387814
START_OPACITY = 0.5
"""Not the 0.1 of Kerbl et al. 2023: dense points lie on surfaces, so that less has to be found out (measured: +0.2 dB
after 1000 steps)."""

SMALLEST_SCALE = 1e-4
"""Floor of a starting scale relative to the median one: points that coincide have no neighbour distance."""

LARGEST_SCALE = 10.0
"""Cap of a starting scale relative to the median one: lone outliers would else cover the whole image."""


START_SHARE = 0.5
"""Share of the budget that training starts with. The rest is for densification to place: a larger start shows more of
the room sooner, a smaller one leaves more for thin branches and lint that flow does not find."""


def starting_gaussians(points: NDArray, colours: NDArray, views: Sequence[View], options: TrainOptions) -> Gaussians:
    """Gaussians at the points of structure from motion and at dense points from the training views."""
    dense, dense_colours = dense_points(
        views,
        points,
        max(0, round(START_SHARE * options.max_gaussians) - len(points)),
        options.seed,
    )
    return initial_gaussians(
        np.concatenate([points, dense]),
        np.concatenate([colours, dense_colours]),
        options.sh_degree,
        options.max_gaussians,
        options.seed,
    )


def initial_gaussians(points: NDArray, colours: NDArray, sh_degree: int, max_gaussians: int, seed: int) -> Gaussians:
    """One isotropic Gaussian a point (Kerbl et al. 2023, section 5.1).

    The standard deviation is the root of the mean squared distance to the three nearest neighbours. Departures from the
    paper: it is kept within SMALLEST_SCALE..LARGEST_SCALE of the median, so that duplicate and lone points stay
    harmless, and more points than the budget are thinned out at random.

    Args:
        points: (N, 3) su; rows that are not finite are left out.
        colours: (N, 3) uint8 RGB.
        sh_degree: degree of the colour; coefficients above the constant start at zero.
        max_gaussians: the budget.
        seed: of the thinning.
    Raises:
        BadInput: fewer than 4 points are finite.
    """
    points = np.asarray(points, np.float64)
    finite = np.flatnonzero(np.isfinite(points).all(axis=1) & (np.abs(points) < 1e30).all(axis=1))
    if len(finite) < 4:
        raise BadInput(f"{len(finite)} usable points to start from (4 needed); film again or use more frames")
    if len(finite) > max_gaussians:
        finite = np.sort(np.random.default_rng(seed).choice(finite, max_gaussians, replace=False))
    points, n = points[finite], len(finite)
    quats = np.zeros((n, 4), np.float32)
    quats[:, 0] = 1.0
    sh = np.zeros((n, (sh_degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = (colours[finite] / np.float32(255) - 0.5) / SH_CONSTANT
    return Gaussians(
        points.astype(np.float32),
        quats,
        np.repeat(np.log(starting_scales(points)).astype(np.float32)[:, None], 3, axis=1),
        np.full(n, np.log(START_OPACITY / (1 - START_OPACITY)), np.float32),
        sh,
    )


def starting_scales(points: NDArray) -> NDArray[np.float64]:
    """(N,) standard deviations, su, finite and positive for any (N, 3) finite points."""
    from scipy.spatial import cKDTree

    k = min(4, len(points))
    distances, _ = cKDTree(points).query(points, k=k)
    distances = distances.reshape(len(points), k)[:, 1:]
    scales = np.sqrt(np.mean(distances**2, axis=1)) if k > 1 else np.zeros(len(points))
    typical = np.median(scales[scales > 0]) if (scales > 0).any() else 0.0
    if not typical > 0:
        # All points coincide: anything positive will do, in proportion to where they are.
        typical = max(float(np.abs(points).max(initial=0.0)), 1e-6) * 1e-3
    return np.clip(scales, SMALLEST_SCALE * typical, LARGEST_SCALE * typical)
