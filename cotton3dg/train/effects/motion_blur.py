# SPDX-License-Identifier: Apache-2.0
"""How far the picture moved while the shutter was open, from the images alone.

Motion averages the picture over a line, and along it edges become ramps as long as the way. The gradient along the
motion then resembles itself farther than the gradient across: its correlation is that of the sharp picture smeared by a
triangle, the line's own correlation. Around triangulated points the sharp picture is much the same in both directions
(corners and spots match best), so the correlation across stands for the sharp picture, and the length is the one whose
triangle turns the correlation across into the one along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ...core.scene import Float64
from ...gaussians.views import View
from .motion import Tracks, measure_velocities

VISIBLE_PX: Final = 2.0
"""A line of this length wipes out the finest detail that an image can show, of one cycle in 2 px."""
CERTAIN: Final = 3.0
"""... and the median length must exceed its own standard error by this factor."""
FEWEST_PLACES: Final = 20
"""Least number of places in an image. With fewer its blur would be a guess."""
MOST_PLACES: Final = 80
"""Largest number of places in an image. More places add nothing."""
SLOWEST_PX: Final = 0.5
"""Least motion, px a frame of the video. A slower place cannot be blurred, and its direction is unsure."""
REACH: Final = 32
"""Correlations are taken up to this distance, px, on lines of twice the length."""
BREADTH: Final = 5
"""Lines beside each other whose mean is taken, 1 px apart."""
LENGTHS_PX: Final = np.arange(0, 24.25, 0.25)
NOISE: Final = 4.0
"""Grey levels squared that a gradient has without any picture: rounding and compression."""


@dataclass(frozen=True)
class MotionBlur:
    """Motion blur of V images; NaN where an image does not determine it."""

    lengths_px: Float64
    """(V,) way of the picture while the shutter was open."""
    flows_px: Float64
    """(V,) way of the picture from one frame of the video to the next, the most that it can be."""

    @property
    def median_px(self) -> float:
        return _quantile(self.lengths_px, 0.5)

    @property
    def strong_px(self) -> float:
        """Length below which nine of ten images stay."""
        return _quantile(self.lengths_px, 0.9)

    @property
    def flow_px(self) -> float:
        return _quantile(self.flows_px, 0.5)

    @property
    def error_px(self) -> float:
        """Standard error of the median, from the scatter among images; infinite without any."""
        known = self.lengths_px[np.isfinite(self.lengths_px)]
        return 1.25 * float(np.std(known)) / np.sqrt(len(known)) if len(known) > 1 else np.inf

    @property
    def found(self) -> bool:
        """Whether most images are blurred visibly, and by no more than they moved."""
        median = self.median_px
        return VISIBLE_PX <= median <= self.flow_px and median > CERTAIN * self.error_px


def estimate_motion_blur(views: Sequence[View], tracks: Tracks) -> MotionBlur:
    """Blur of all images.

    Args:
        views: V images, those of `tracks.cameras`, of any size.
        tracks: places in px of `tracks.cameras`.
    """
    import cv2

    speeds = measure_velocities(tracks)
    scales = np.array([view.camera.width / camera.width for view, camera in zip(views, tracks.cameras, strict=True)])
    speeds = speeds * scales[tracks.views, None]
    flows = np.linalg.norm(speeds, axis=1)
    along, across = np.full((2, len(views), REACH), np.nan)
    middle = np.full(len(views), np.nan)
    for number, view in enumerate(views):
        mine = np.flatnonzero((tracks.views == number) & np.isfinite(flows))
        if len(mine) < FEWEST_PLACES:
            continue
        middle[number] = np.median(flows[mine])
        mine = mine[flows[mine] > SLOWEST_PX]
        places = tracks.places_px[mine] * scales[number]
        inside = ((places > REACH) & (places < np.array(view.image.shape[1::-1]) - REACH)).all(axis=1)
        mine, places = mine[inside], places[inside]
        if len(mine) < FEWEST_PLACES:
            continue
        spread = np.arange(0, len(mine), -(-len(mine) // MOST_PLACES))
        mine, places = mine[spread], places[spread]
        directions = speeds[mine] / flows[mine, None]
        grey = cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY).astype(np.float32)
        along[number] = _correlate(grey, places, directions)
        across[number] = _correlate(grey, places, directions[:, ::-1] * (-1, 1))
    known = np.isfinite(along[:, 0])
    lengths = np.full(len(views), np.nan)
    if known.any():
        smears = np.array([smear(across[known].mean(axis=0), length) for length in LENGTHS_PX])
        lengths[known] = [blur_length(correlation, smears) for correlation in along[known]]
    return MotionBlur(lengths, middle)


def smear(correlation: Float64, length_px: float) -> Float64:
    """(REACH,) correlation at 0, 1, 2 ... px of gradients after a blur along a line."""
    lags, places = np.arange(len(correlation)), np.linspace(-1, 1, 65)
    triangle = 1 - np.abs(places)
    at = np.abs(lags[:, None] + length_px * places)
    smeared: Float64 = np.interp(at, lags, correlation) @ (triangle / triangle.sum())
    return smeared


def blur_length(correlation: Float64, smears: Float64) -> float:
    """The length in LENGTHS_PX whose smear (L, REACH) is, times a factor, most like a correlation (REACH,).

    Distance 0 does not count: the sensor's noise resembles nothing but itself.
    """
    smears, seen = smears[:, 1:], correlation[1:]
    factors = (smears @ seen) / (smears**2).sum(axis=1)
    return float(LENGTHS_PX[np.argmin(((seen - factors[:, None] * smears) ** 2).sum(axis=1))])


def _correlate(grey: NDArray[np.float32], places: Float64, directions: Float64) -> Float64:
    """(REACH,) mean correlation of the gradient along `directions` (K, 2) with itself, around `places` (K, 2) px."""
    import cv2

    steps = np.arange(2 * REACH) - (REACH - 0.5)
    aside = np.arange(BREADTH)[:, None] - (BREADTH - 1) / 2
    normals = directions[:, ::-1] * (-1, 1)
    # OpenCV counts pixels from their centres.
    x, y = (
        (place[:, None, None] - 0.5 + aside * normal[:, None, None] + steps * direction[:, None, None]).astype(
            np.float32
        )
        for place, normal, direction in zip(places.T, normals.T, directions.T, strict=True)
    )
    flat = (-1, 2 * REACH)
    lines = cv2.remap(grey, x.reshape(flat), y.reshape(flat), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    gradients = np.diff(lines.reshape(x.shape), axis=2)
    # By Fourier transforms, long enough that no line meets itself again around the end.
    spectra = np.fft.rfft(gradients, 3 * REACH, axis=2)
    power = (spectra.real**2 + spectra.imag**2).sum(axis=1)
    products = np.fft.irfft(power, 3 * REACH, axis=1)[:, :REACH] / (BREADTH * (gradients.shape[2] - np.arange(REACH)))
    correlation: Float64 = (products / (products[:, :1] + NOISE)).mean(axis=0)
    return correlation


def _quantile(values: Float64, share: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, share)) if len(known) else float("nan")
