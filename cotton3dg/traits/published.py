# SPDX-License-Identifier: Apache-2.0
"""Traits as Cotton3DGaussians defines them, in columns of their own beside the defaults.

A boll's volume is that of the convex hull of its Gaussians' means; the plant's height is the upright side of the
oriented box around the means of its Gaussians, and its canopy the mean of that box's other two sides. Reading: the foot
of the stem, which the clamp hides, belongs to the plant, else every plant would be shorter by the clamp.

The defaults differ for two reasons: means lie inside a surface, so their hull is smaller than the boll; and a box along
the principal axes leans with the plant, so its sides are neither height nor width.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Gaussians
from ..geometry.boxes import oriented_box
from ..geometry.convex_measures import Measured, convex_volume


@dataclass(frozen=True)
class PublishedSize:
    """Size of a plant, cm."""

    height_cm: float = nan
    canopy_cm: float = nan


NO_PUBLISHED_SIZE: Final = PublishedSize()


def hull_of_means(boll: Gaussians) -> Measured:
    """Volume of the convex hull of the means of a boll's Gaussians, su³."""
    return convex_volume(boll.means)


def box_of_means(places: NDArray[np.float64]) -> PublishedSize:
    """Height and canopy of the oriented box around (N, 3) places in the plant frame, cm, and the foot."""
    box = oriented_box(np.vstack([places, np.zeros(3)]))
    upright = int(np.abs(box.axes[:, 2]).argmax())
    return PublishedSize(float(box.sides[upright]), float(np.delete(box.sides, upright).mean()))
