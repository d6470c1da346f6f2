# SPDX-License-Identifier: Apache-2.0
"""How far the camera has gone, measured by corners that are followed from frame to frame.

The unit is the longer side of the image: a phone that goes once around a plant and looks at it pans over about five.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..io.images import scale_down

SIDE_PX: Final = 320
"""Frames are compared at this size."""
CORNERS: Final = 150
LEAST_CORNERS: Final = 10
FARTHEST: Final = 0.06
"""Way beyond which corners are chosen anew."""
LEAST_FOLLOWED: Final = 0.5
"""Share of followed corners below which the way is unknown, and the camera is assumed to go on as before."""
PERCENTILE: Final = 80
"""Percentile of the corners' ways. When the camera goes round, the background moves most and the plant hardly."""


class WayMeter:
    """Measures the way of a camera from the frames of a film, one by one.

    Corners are measured from the places where they were chosen (Shi and Tomasi 1994; Lucas and Kanade 1981), so a hand
    that trembles on the spot does not add to the way.
    """

    def __init__(self) -> None:
        self.way = 0.0
        """From the first frame to the last one given."""
        self._base = 0.0
        self._before: NDArray[np.uint8] | None = None
        self._chosen = self._now = np.zeros((0, 1, 2), np.float32)
        self._step = 0.0

    def add(self, grey: NDArray[np.uint8]) -> float:
        """The way up to this (H, W) frame."""
        small = np.asarray(scale_down(grey, SIDE_PX), np.uint8)
        if self._before is None:
            self._choose(small)
        else:
            self._go_on(small)
        self._before = small
        return self.way

    def _go_on(self, small: NDArray[np.uint8]) -> None:
        gone = self._follow(small)
        if math.isnan(gone):
            self.way += self._step
            self._choose(small)
            return
        ahead = max(self.way, self._base + gone)
        self._step, self.way = ahead - self.way, ahead
        if gone > FARTHEST:
            self._choose(small)

    def _follow(self, small: NDArray[np.uint8]) -> float:
        """How far the corners are from where they were chosen; NaN when most are lost."""
        import cv2

        if len(self._now) < LEAST_CORNERS:
            return math.nan
        before: Any = self._before
        moved, found, _ = cv2.calcOpticalFlowPyrLK(before, small, self._now, None, winSize=(15, 15), maxLevel=2)
        followed = found.ravel() == 1
        if followed.mean() < LEAST_FOLLOWED:
            return math.nan
        self._chosen, self._now = self._chosen[followed], moved[followed]
        ways = np.linalg.norm((self._now - self._chosen).reshape(-1, 2), axis=1)
        travelled: float = float(np.percentile(ways, PERCENTILE)) / max(small.shape)
        return travelled

    def _choose(self, small: NDArray[np.uint8]) -> None:
        import cv2

        corners = cv2.goodFeaturesToTrack(small, maxCorners=CORNERS, qualityLevel=0.01, minDistance=6)
        self._chosen = self._now = np.zeros((0, 1, 2), np.float32) if corners is None else corners
        self._base = self.way
