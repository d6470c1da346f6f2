"""Objects of single views joined by the distance of their centres, the nearest first.

This is a plain alternative to DBSCAN (`dbscan`) that compares whole objects, never points. Two clusters that share a
view never join, because a rule on pairs alone leaks through chains. Distance and volume are bounded by multiples of
the sizes that the masks themselves show, so the unit of length does not matter.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..core.bolls import BollInstance, LiftedMasks
from ..core.scene import Float32, Float64
from ..geometry.point_sets import measure_extent
from .view_objects import bolls_of_groups, find_objects, join_nearest

VOLUME_CAP: Final = 3.0
"""Largest bounding volume of a cluster, relative to the median of one mask's, which covers the visible half of a
boll."""
LEAST_VIEWS: Final = 2


def join_objects(lifted: LiftedMasks, means: Float32, up: Float64, reach: float = 0.6) -> list[BollInstance]:
    """Bolls as clusters of nearby objects of different views.

    Args:
        lifted: masks lifted onto the Gaussians.
        means: (N, 3) su.
        up: (3,) roughly upwards in the scene; only the numbering depends on it.
        reach: farthest distance between the centres of two clusters that join, in median widths of one mask.
    Returns:
        bolls of at least two views, see `bolls_of_groups`.
    """
    points = np.asarray(means, np.float64)
    objects = find_objects(lifted, points)
    if not objects:
        return []
    shapes = [measure_extent(points[item.rows]) for item in objects]
    centres, widths = np.array([shape[0] for shape in shapes]), np.array([shape[1] for shape in shapes])
    cap = VOLUME_CAP * float(np.median(widths.prod(axis=1)))

    def fits(ours: list[int], theirs: list[int]) -> bool:
        union = np.unique(np.concatenate([objects[k].rows for k in ours + theirs]))
        return bool(measure_extent(points[union])[1].prod() <= cap)

    view_of = np.array([item.view for item in objects])
    groups = join_nearest(centres, view_of, fits, reach * float(np.median(widths[:, 0])))
    return bolls_of_groups([[objects[k] for k in group] for group in groups], lifted, points, up, LEAST_VIEWS)
