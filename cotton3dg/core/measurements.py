"""What is measured on a plant, with its units: scale, boll traits, plant traits."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Scale:
    """Metric size and orientation of a scene.

    The plant frame has z up from the table top, x along the table's long side and its origin where the stem
    meets the table: `plant_from_scene` maps su to cm.
    """

    cm_per_su: float
    relative_error: float
    """Estimated standard error of `cm_per_su`, relative."""
    source: str
    """The reference that gave it, e.g. `table`."""
    up: Float64
    """(3,) unit vector in the scene."""
    plane: Float64
    """(4,) a, b, c, d of the table top: a x + b y + c z + d = height above the table, su; (a, b, c) = up."""
    corners: Float64
    """(4, 3) corners of the table top in order around it, su; edge 0-1 is a long side."""

    @property
    def table_frame(self) -> Float64:
        """(3, 3) rows: unit x (long side), y, z (up) of the table in the scene."""
        x = self.corners[1] - self.corners[0]
        x = x - self.up * (x @ self.up)
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(self.up, x), self.up])

    def height_cm(self, points: NDArray) -> Float64:
        """(N,) height of (N, 3) scene points above the table top."""
        return (np.asarray(points, np.float64) @ self.plane[:3] + self.plane[3]) * self.cm_per_su


@dataclass(frozen=True)
class BollTraits:
    """One row of bolls.csv; NaN = not measurable, the reason is among the flags."""

    boll_id: int
    centre_cm: Float64
    """(3,) in the plant frame."""
    volume_cm3: float
    alpha_volume_cm3: float
    diameter_cm: float
    n_gaussians: int
    n_views: int
    confidence: float
    flags: tuple[str, ...] = ()
    volume_error_cm3: float = nan
    """Standard error, of scale and view support."""
    projected_area_cm2: float = nan
    """Mean over all directions."""


@dataclass(frozen=True)
class PlantTraits:
    """The plant's part of traits.csv; NaN = not measurable, the reason is among the flags."""

    boll_count: int
    boll_volume_cm3: float
    boll_volume_mean_cm3: float
    plant_height_cm: float
    plant_height_obb_cm: float
    canopy_size_cm: float
    canopy_length_cm: float
    canopy_width_cm: float
    flags: tuple[str, ...] = ()
    plant_hull_volume_cm3: float = nan
    boll_height_mean_cm: float = nan
    boll_height_sd_cm: float = nan
    boll_height_min_cm: float = nan
    boll_height_max_cm: float = nan
    bolls_by_third: tuple[int, int, int] | None = None
    """Bolls with their centre in the lower, middle and upper third of the plant's height; None = not measurable."""
    lint_area_cm2: float = nan
    boll_count_error: float = nan
    boll_volume_error_cm3: float = nan
    plant_height_error_cm: float = nan
    canopy_size_error_cm: float = nan
