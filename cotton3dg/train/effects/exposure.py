# SPDX-License-Identifier: Apache-2.0
"""Finds whether the camera changed its exposure or white balance along the way, and corrects the images if it did.

The colours of triangulated points in each image show it before any training. A point keeps its colour. The logarithm
of its colour in an image is the point's own plus the image's gain, and both follow from all observations by robust
least squares. sRGB is close to a power law, so a factor of the light is a factor of the values, except where they
saturate; such observations are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...core.scene import Float64
from ...gaussians.views import View

DARKEST: Final = 15
BRIGHTEST: Final = 235
"""Values between which a channel is neither noise nor saturated."""
MOST_POINTS: Final = 2000
"""Number of points that are used, those seen in the most images: they tie distant images together."""
FEWEST_OBSERVATIONS: Final = 20
"""Least number of observations of an image. With fewer its gain would be a guess, and the image stays as it is."""
PATCH_PX: Final = 3
"""Side of the square whose mean is a point's colour in an image."""
HUBER: Final = 1.5
"""Residuals beyond this many standard deviations lose weight: highlights and wrong matches."""
ROUNDS: Final = 5
"""Rounds of reweighting. After these the gains move by less than a tenth of their error."""

VISIBLE: Final = 0.01
"""Standard deviation of the log gains from which they are corrected. On mid-grey it is an error 46 dB below white,
which begins to count beside the 30 to 35 dB of a model."""
CERTAIN: Final = 3.0
"""... and it must exceed its own standard error by this factor, ..."""
ALIKE: Final = 0.9
"""... and dark and bright points must show the same changes. (0.99 for two films whose exposure changed, 0.4 to 0.7
for three real sets of photos; one of these lost 2 dB when it was corrected.)"""


@dataclass(frozen=True)
class Exposure:
    """How much brighter than the mean image each image is, and how sure that is."""

    gains: Float64
    """(V, 3) factors of the RGB values; their logarithms have mean zero over the fitted images."""
    spread: float
    """Standard deviation of the log gains over fitted images and channels."""
    error: float
    """Standard error of a log gain, from the green of two halves of the points."""
    n_observations: int
    likeness: float = 1.0
    """Correlation of the log gains from the dark and from the bright half of the points, all channels. The camera
    changes both alike; a gleam or haze that comes and goes with the direction of view affects each differently."""

    @property
    def varies(self) -> bool:
        """Whether the exposure varies enough to correct it."""
        return self.spread > VISIBLE and self.spread > CERTAIN * self.error and self.likeness > ALIKE


def estimate_exposure(
    views: Sequence[View],
    places_px: Sequence[Float64],
    points: Sequence[NDArray[np.int64]],
    fitted: NDArray[np.bool_] | None = None,
) -> Exposure:
    """Gains of all images.

    Args:
        views: V photos with their cameras.
        places_px: for each view (K, 2) where it shows triangulated points, in pixels of its camera.
        points: for each view (K,) the numbers of those points.
        fitted: (V,) views from which the points get their colours; None = all. The gains of the others follow from
            those colours and change nothing else.
    Returns:
        Gains of 1 and an infinite error where the points do not determine them.
    """
    n, fitted = len(views), np.ones(len(views), bool) if fitted is None else fitted
    colours, rows, ids = _observe(views, places_px, points, fitted)
    known = np.bincount(rows, minlength=n) >= FEWEST_OBSERVATIONS
    sure, used = known & fitted, fitted[rows]
    if sure.sum() < 2:
        return Exposure(np.ones((n, 3)), 0.0, np.inf, int(used.sum()))
    half = np.arange(ids.max() + 1) % 2 == 0
    logs = np.stack([log_gains(values[used], rows[used], ids[used], n) for values in colours.T], axis=1)
    parts = [used & half[ids], used & ~half[ids]]
    halves = [log_gains(colours[part, 1], rows[part], ids[part], n) for part in parts]
    logs -= logs[sure].mean(axis=0)
    for view in np.flatnonzero(known & ~fitted).tolist():
        logs[view] = _compare(view, logs, colours, rows, ids, used)
    logs[~known] = 0
    # Each half has twice the variance of the whole, and the difference of both twice that again.
    error = float(np.sqrt(np.mean((halves[0] - halves[1])[sure] ** 2)) / 2)
    spread = float(np.sqrt(np.mean(logs[sure] ** 2)))
    return Exposure(np.exp(logs), spread, error, int(used.sum()), _likeness(colours[used], rows[used], ids[used], sure))


def _likeness(colours: Float64, rows: NDArray[np.int64], ids: NDArray[np.int64], sure: NDArray[np.bool_]) -> float:
    """Correlation between the log gains of dark and of bright points, over channels and views."""
    counts = np.bincount(ids)
    both = []
    for values in colours.T:
        brightness = np.bincount(ids, values) / np.maximum(counts, 1)
        bright = (brightness > np.median(brightness[counts > 0]))[ids]
        dark_gains, bright_gains = (
            log_gains(values[part], rows[part], ids[part], len(sure))[sure] for part in (~bright, bright)
        )
        both.append((dark_gains - dark_gains.mean(), bright_gains - bright_gains.mean()))
    dark, light = np.swapaxes(both, 0, 1).reshape(2, -1)
    lengths = np.linalg.norm(dark) * np.linalg.norm(light)
    return float(dark @ light / lengths) if lengths > 0 else 0.0


def _compare(
    view: int,
    logs: Float64,
    colours: Float64,
    rows: NDArray[np.int64],
    ids: NDArray[np.int64],
    used: NDArray[np.bool_],
) -> Float64:
    """(3,) log gain of a view that was not fitted: the median by which its points are brighter than in fitted views.

    Args:
        logs: (V, 3) log gains of the fitted views.
        colours, rows, ids: as `_observe` returns them.
        used: (K,) whether a fitted view made the observation.
    """
    counts = np.bincount(ids[used], minlength=ids.max() + 1)
    unlit = colours[used] - logs[rows[used]]
    usual = np.stack([np.bincount(ids[used], values, len(counts)) / counts for values in unlit.T], axis=1)
    own = rows == view
    median: Float64 = np.median(colours[own] - usual[ids[own]], axis=0)
    return median


def _observe(
    views: Sequence[View], places_px: Sequence[Float64], points: Sequence[NDArray[np.int64]], fitted: NDArray[np.bool_]
) -> tuple[Float64, NDArray[np.int64], NDArray[np.int64]]:
    """Log colours (K, 3) that are neither dark nor saturated, view (K,) and number of the point (K,) from 0 on.

    Only points that at least two `fitted` views show are among them.
    """
    import cv2

    colours, rows, ids = [], [], []
    for row, (view, places, own) in enumerate(zip(views, places_px, points, strict=True)):
        smooth = cv2.blur(view.image, (PATCH_PX, PATCH_PX))
        x, y = np.floor(np.asarray(places).reshape(-1, 2).T).astype(np.int64)
        inside = (x >= 0) & (y >= 0) & (x < view.camera.width) & (y < view.camera.height)
        seen = smooth[y[inside], x[inside]].astype(np.float64)
        good = ((seen >= DARKEST) & (seen <= BRIGHTEST)).all(axis=1)
        colours.append(np.log(seen[good]))
        ids.append(np.asarray(own)[inside][good])
        rows.append(np.full(int(good.sum()), row))
    names, number = np.unique(np.concatenate(ids), return_inverse=True)
    shown_by = np.concatenate(rows)
    counts = np.bincount(number[fitted[shown_by]], minlength=len(names))
    chosen = np.zeros(len(names), bool)
    chosen[np.argsort(-counts, kind="stable")[:MOST_POINTS]] = True
    chosen &= counts > 1
    keep = chosen[number]
    return np.concatenate(colours)[keep], shown_by[keep], (np.cumsum(chosen) - 1)[number[keep]]


def log_gains(values: Float64, rows: NDArray[np.int64], ids: NDArray[np.int64], n_views: int) -> Float64:
    """(V,) offsets, of mean zero, that best explain `values` (K,) = offset of the view + constant of the point.

    Iteratively reweighted least squares (Huber). The points are eliminated, so that a system of V unknowns is left.
    """
    ids = np.unique(ids, return_inverse=True)[1]
    n_points = int(ids.max(initial=-1)) + 1
    weights = np.ones(len(values))
    offsets: NDArray[Any] = np.zeros(n_views)
    for _ in range(ROUNDS):
        of_point = np.bincount(ids, weights, n_points)
        # Dense: MOST_POINTS bounds it, and sparse products take longer.
        shared = np.bincount(rows * n_points + ids, weights, n_views * n_points).reshape(n_views, n_points)
        normal = np.diag(np.bincount(rows, weights, n_views)) - (shared / of_point) @ shared.T
        right: NDArray[Any] = np.bincount(rows, weights * values, n_views)
        right = right - shared @ (np.bincount(ids, weights * values, n_points) / of_point)
        # Least norm: the common offset is free, and so is that of views without a common point.
        offsets = np.linalg.lstsq(normal, right, rcond=1e-9)[0]
        constants = np.bincount(ids, weights * (values - offsets[rows]), n_points) / of_point
        residuals = np.abs(values - offsets[rows] - constants[ids])
        limit = HUBER * max(1.4826 * float(np.median(residuals)), 1e-9)
        weights = 1 / np.maximum(1, residuals / limit)
    centred: Float64 = offsets - offsets.mean()
    return centred


def correct(view: View, gains: Float64) -> View:
    """The view as the mean image's exposure would have taken it; saturated pixels stay as dark as they became."""
    levels = np.clip(np.rint(np.arange(256)[:, None] / gains), 0, 255).astype(np.uint8)
    image = np.stack([levels[view.image[..., channel], channel] for channel in range(3)], axis=-1)
    return View(view.camera, image)
