"""The traits of a plant from a scanner's point cloud, by the code that measures Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64
from ..geometry.convex_measures import convex_volume
from ..traits.isolate import STEM_LAYERS, STEM_RADIUS_CM, find_connected, fit_stem_axis
from ..traits.measure import PlantSize, measure_places

LAYER_CM = 0.5
TABLE_SHARE = 0.05
"""Of the points in one layer of `LAYER_CM`; a plant alone has a hundredth in each."""


@dataclass(frozen=True)
class CloudTraits:
    """What a cloud tells; NaN where it does not."""

    silhouette: PlantSize
    boll_volumes_cm3: Float64
    """(B,) of the bolls that are marked; empty when none are."""
    on_table: bool
    """False: the cloud has no table, so heights count from its lowest point."""


def measure_cloud(points_cm: NDArray, labels: NDArray | None = None, clamp_height_cm: float = 4.0) -> CloudTraits:
    """Traits of a cloud whose z points up.

    Where the cloud has a table, the fullest level layer of its lower half, the plant is what hangs together with the
    stem above the clamp; else all of it is the plant.

    Args:
        points_cm: (N, 3). labels: (N,) boll of each point, 0 = none.
    """
    points = np.asarray(points_cm, np.float64)
    level = find_table_height(points[:, 2])
    places = points - np.array([0.0, 0.0, points[:, 2].min() if level is None else level])
    plant = places
    if level is not None:
        floor_cm = clamp_height_cm + 1.0
        above = places[places[:, 2] > floor_cm]
        stem = fit_stem_axis(above, floor_cm) if len(above) else None
        if stem is not None:
            base, top = stem
            share = (above[:, 2] - base[2]) / (top[2] - base[2])
            beside = np.linalg.norm((above - base - share[:, None] * (top - base))[:, :2], axis=1) < STEM_RADIUS_CM
            seeds = beside & (above[:, 2] < floor_cm + STEM_LAYERS)
            above = above[find_connected(above[:, None], seeds)]
            places = places - np.append(base[:2], 0.0)
            above = above - np.append(base[:2], 0.0)
        plant = above
    volumes = []
    if labels is not None:
        for boll in np.unique(labels[labels > 0]):
            volumes.append(convex_volume(points[labels == boll]).value)
    if not len(plant):
        return CloudTraits(PlantSize(), np.array(volumes), level is not None)
    return CloudTraits(measure_places(plant, plant[:, 2], plant), np.array(volumes), level is not None)


def find_table_height(heights: NDArray) -> float | None:
    """Where the table top is: the median of the fullest layer of the lower half; None when no layer is that full."""
    low = float(np.min(heights))
    layers = np.floor((heights - low) / LAYER_CM).astype(np.int64)
    counts = np.bincount(layers)
    lower = counts[: max(1, len(counts) // 2)]
    best = int(lower.argmax())
    if lower[best] < TABLE_SHARE * len(heights):
        return None
    near = np.abs(layers - best) <= 1
    return float(np.median(heights[near]))
