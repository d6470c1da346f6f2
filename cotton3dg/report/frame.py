# SPDX-License-Identifier: Apache-2.0
"""Coordinates of a plant's page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.measurements import Scale
from ..core.scene import Float64
from ..geometry.camera_orbit import Orbit


@dataclass(frozen=True)
class Frame:
    """The coordinates of the page: those of bolls.csv in cm where there is a scale, else around the orbit's axis."""

    page_from_scene: Float64
    """(3, 3) rotation times the scale."""
    offset: Float64
    """(3,) in the page's unit."""
    unit: str

    def places(self, points: NDArray[Any]) -> Float64:
        """(N, 3) of (N, 3) scene points."""
        return np.asarray(points, np.float64) @ self.page_from_scene.T + self.offset

    @property
    def origin(self) -> Float64:
        """(3,) su of its origin: where the stem meets the table, if the bolls or the plant show it."""
        return np.linalg.inv(self.page_from_scene) @ -self.offset


def plant_frame(scale: Scale | None, orbit: Orbit, centres: Float64, centres_cm: Float64, plant: NDArray[Any]) -> Frame:
    """Coordinates for the page.

    Args:
        centres: (B, 3) su of the bolls, and centres_cm: (B, 3) of the same from the table; rows of NaN are unknown.
        plant: (P, 3) su, points of the plant; their lowest tenth gives its foot if no boll does.
    """
    if scale is None:
        helper = np.eye(3)[np.abs(orbit.axis).argmin()]
        x = np.cross(helper, orbit.axis)
        x /= np.linalg.norm(x)
        axes = np.stack([x, np.cross(orbit.axis, x), orbit.axis])
        return Frame(axes, -axes @ orbit.centre, "scene units")
    axes = scale.cm_from_scene
    foot = scale.corners.mean(axis=0)
    if len(plant):
        foot = np.median(plant[np.argsort(plant @ scale.up)[: max(1, len(plant) // 10)]], axis=0)
    offset = -axes @ foot
    known = np.isfinite(centres_cm).all(axis=1) if len(centres_cm) else np.zeros(0, bool)
    if known.any():
        offset = np.median(centres_cm[known] - centres[known] @ axes.T, axis=0)
    offset[2] = scale.plane[3] * scale.cm_per_su
    return Frame(axes, offset, "cm")
