# SPDX-License-Identifier: Apache-2.0
"""The Gaussians that training starts from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import SH_CONSTANT, Camera, Float64, Gaussians
from ..errors import CaptureFailed
from ..gaussians.views import View
from ..geometry.camera_orbit import fit_orbit
from ..options import TrainOptions
from .densify import concatenate
from .flow_points import find_dense_points
from .random_streams import open_stream

START_OPACITY: Final = 0.5
"""Not the 0.1 of Kerbl et al. 2023: dense points lie on surfaces, so the training has less to find out (measured:
+0.2 dB after 1000 steps)."""

SMALLEST_SCALE: Final = 1e-4
"""Floor of a starting scale relative to the median one: points that coincide have no neighbour distance."""

LARGEST_SCALE: Final = 10.0
"""Cap of a starting scale relative to the median one; without it lone outliers would cover the whole image."""


START_SHARE: Final = 0.3
"""Share of the budget that training starts with. The rest is for densification to place: a larger start shows more of
the room sooner, a smaller one leaves more for thin branches and lint that flow does not find."""

FILL_SHARE: Final = 0.1
"""Share of the budget that fills the plant region evenly, whether points lie there or not."""

FILL_REACH: Final = 0.4
"""Radius of the filled ball relative to the cameras' distance from their target."""

FILL_OPACITY: Final = 0.1
"""As in Kerbl et al. 2023: most of the filling stands in thin air and has to vanish."""

POINT_OPACITY: Final = 0.1
"""Opacity at the points of structure from motion alone, as in Kerbl et al. 2023. Cotton3DGaussians writes opacity 1 and
unit covariance. But the logit of 1 is infinite and has no gradient, and opaque Gaussians of 1 su, a third of a metre,
hide from every ray everything behind the first one."""


def start_gaussians(
    points: NDArray[Any], colours: NDArray[Any], views: Sequence[View], options: TrainOptions
) -> Gaussians:
    """Gaussians at the points of structure from motion, at dense points from the training views, and a thin filling.

    Neither features nor flow find a lone white boll in front of a textured wall, and splitting cannot reach it from
    elsewhere in a short training. The filling leaves something there to grow. (Measured on a simulated plant at
    640x360, 2000 steps: 7 instead of 5 of its 8 bolls.)

    `options.start = "points"`: the points of structure from motion alone.
    """
    if options.start == "points":
        return place_gaussians(
            points, colours, options.sh_degree, options.max_gaussians, options.seed, opacity=POINT_OPACITY
        )
    n_filling = round(FILL_SHARE * options.max_gaussians)
    n_dense = max(0, round(START_SHARE * options.max_gaussians) - len(points))
    dense, dense_colours = find_dense_points(views, points, n_dense, options.seed)
    found = place_gaussians(
        np.concatenate([points, dense]),
        np.concatenate([colours, dense_colours]),
        options.sh_degree,
        options.max_gaussians - n_filling,
        options.seed,
    )
    return concatenate([found, fill([view.camera for view in views], n_filling, options.sh_degree, options.seed)])


def fill(cameras: Sequence[Camera], count: int, sh_degree: int, seed: int) -> Gaussians:
    """`count` faint grey Gaussians, evenly spread over the ball at which the cameras look; they hardly overlap."""
    orbit = fit_orbit(cameras)
    rng = open_stream(seed, "filling")
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    reach_su = FILL_REACH * orbit.distance
    sigma_su = 0.3 * reach_su * (4 * np.pi / 3 / max(count, 1)) ** (1 / 3)
    means = orbit.centre + directions * reach_su * np.cbrt(rng.random((count, 1)))
    return _isotropic(means, np.full(count, sigma_su), FILL_OPACITY, sh_degree)


def place_gaussians(
    points: NDArray[Any],
    colours: NDArray[Any],
    sh_degree: int,
    max_gaussians: int,
    seed: int,
    opacity: float = START_OPACITY,
) -> Gaussians:
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
        CaptureFailed: fewer than 4 points are finite.
    """
    points = np.asarray(points, np.float64)
    finite = np.flatnonzero(np.isfinite(points).all(axis=1) & (np.abs(points) < 1e30).all(axis=1))
    if len(finite) < 4:
        raise CaptureFailed(f"{len(finite)} usable points to start from (4 needed); film again or use more frames")
    if len(finite) > max_gaussians:
        finite = np.sort(open_stream(seed, "thinning").choice(finite, max_gaussians, replace=False))
    gaussians = _isotropic(points[finite], starting_scales(points[finite]), opacity, sh_degree)
    gaussians.sh[:, 0] = (colours[finite] / np.float32(255) - 0.5) / SH_CONSTANT
    return gaussians


def _isotropic(means: Float64, sigmas_su: Float64, opacity: float, sh_degree: int) -> Gaussians:
    """Grey Gaussians at (N, 3) `means` with (N,) standard deviations."""
    n = len(means)
    return Gaussians(
        means.astype(np.float32),
        np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        np.repeat(np.log(sigmas_su).astype(np.float32)[:, None], 3, axis=1),
        np.full(n, np.log(opacity / (1 - opacity)), np.float32),
        np.zeros((n, (sh_degree + 1) ** 2, 3), np.float32),
    )


def starting_scales(points: NDArray[Any]) -> NDArray[np.float64]:
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
