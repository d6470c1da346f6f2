# SPDX-License-Identifier: Apache-2.0
"""The traits of a plant from a scanner's point cloud, by the code that measures Gaussians."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.plant_map import PlantMap
from ..core.scene import Float64
from ..geometry.convex_measures import calliper_diameter, convex_volume
from ..plant_map.map_plant import map_cloud
from ..traits.plant_segmentation import STEM_LAYERS, STEM_RADIUS_CM, find_connected, fit_stem_axis
from ..traits.plant_size import PlantSize, measure_places

LAYER_CM: Final = 0.5
TABLE_SHARE: Final = 0.05
"""Share of the points in one layer of `LAYER_CM`; a plant alone has a hundredth in each."""


@dataclass(frozen=True)
class CloudTraits:
    """The traits that a cloud shows; NaN for the others."""

    silhouette: PlantSize
    boll_volumes_cm3: Float64
    """(B,) volumes of the marked bolls; empty if none are marked."""
    on_table: bool
    """False: the cloud has no table, so heights count from its lowest point."""
    plant_map: PlantMap
    """Stem and branches, and the marked bolls on them."""


def measure_cloud(
    points_cm: NDArray[Any], labels: NDArray[Any] | None = None, clamp_height_cm: float = 4.0
) -> CloudTraits:
    """Traits of a cloud whose z points up.

    If the cloud has a table, which is the fullest level layer of its lower half, the plant is everything connected with
    the stem above the clamp. Otherwise the whole cloud is the plant, which stands on its lowest points.

    Args:
        points_cm: (N, 3). labels: (N,) boll of each point, 0 = none.
    """
    points = np.asarray(points_cm, np.float64)
    level = find_table_height(points[:, 2])
    places = points - np.array([0.0, 0.0, points[:, 2].min() if level is None else level])
    of_plant = np.arange(len(places))
    if level is not None:
        floor_cm = clamp_height_cm + 1.0
        of_plant = np.flatnonzero(places[:, 2] > floor_cm)
        above = places[of_plant]
        stem = fit_stem_axis(above, floor_cm) if len(above) else None
        if stem is not None:
            base, top = stem
            share = (above[:, 2] - base[2]) / (top[2] - base[2])
            beside = np.linalg.norm((above - base - share[:, None] * (top - base))[:, :2], axis=1) < STEM_RADIUS_CM
            seeds = beside & (above[:, 2] < floor_cm + STEM_LAYERS)
            of_plant = of_plant[find_connected(above[:, None], seeds)]
            places = places - np.append(base[:2], 0.0)
    lint = np.zeros(len(points), bool) if labels is None else labels > 0
    if level is None:
        places = places - find_foot(places, lint)
    plant = places[of_plant]
    volumes, bolls = [], []
    if labels is not None:
        for boll in np.unique(labels[lint]):
            own = places[labels == boll]
            volumes.append(convex_volume(own).value)
            diameter = calliper_diameter(own).value
            bolls.append((int(boll), own.mean(axis=0), diameter))
    if not len(plant):
        nothing = PlantMap((), (), "no_plant")
        return CloudTraits(PlantSize(), np.array(volumes), level is not None, nothing)
    plant_map = map_cloud(plant[~lint[of_plant]], bolls)
    size = measure_places(plant, plant[:, 2], plant)
    return CloudTraits(size, np.array(volumes), level is not None, plant_map)


def find_foot(points: Float64, lint: NDArray[np.bool_]) -> Float64:
    """(3,) where a plant without a table stands: below the middle of its lowest wood, at its lowest point.

    Args:
        points: (N, 3) cm. lint: (N,) whether a point is a boll's.
    """
    wood = points[~lint] if (~lint).any() else points
    low = wood[wood[:, 2] < wood[:, 2].min() + LAYER_CM]
    return np.append(np.median(low[:, :2], axis=0), points[:, 2].min())


def find_table_height(heights: Float64) -> float | None:
    """Height of the table top: the median of the fullest layer of the lower half; None if no layer is that full."""
    low = float(np.min(heights))
    layers = np.floor((heights - low) / LAYER_CM).astype(np.int64)
    counts = np.bincount(layers)
    lower = counts[: max(1, len(counts) // 2)]
    best = int(lower.argmax())
    if lower[best] < TABLE_SHARE * len(heights):
        return None
    near = np.abs(layers - best) <= 1
    return float(np.median(heights[near]))
