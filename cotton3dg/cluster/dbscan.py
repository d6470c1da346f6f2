# SPDX-License-Identifier: Apache-2.0
"""The clustering of Cotton3DGaussians: DBSCAN on the points of all views' objects.

As published: objects whose convex hull is too large are left out, DBSCAN (Ester et al. 1996; Open3D's) runs over the
points of all others with eps = 0.3 and min_samples = 10, and only objects of different views become one boll. A boll
that a single view shows stays.

Departures and readings:

- The paper's eps of 0.3 and its cap of 25,000 are in the arbitrary unit of its model. Here eps is in median widths of
  an object and the cap in median hulls. (Two path-traced plants give the same bolls with 0.3, 0.4 and 0.6; a sparse
  model with 30 Gaussians an object has too few points within 0.3.)
- Points of touching bolls are one cluster of DBSCAN. The paper forbids that two objects of one view are one boll, but
  does not say how to divide such a cluster. Here it is divided as in C-DBSCAN (Ruiz et al. 2007): within a cluster,
  objects whose points come within eps join, the nearest centres first, unless the two share a view.
- With more than five views, a boll is dropped if fewer than a fifth of the views that could find it do
  (`LEAST_CONFIDENCE`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from ..core.bolls import BollInstance, LiftedMasks
from ..core.libraries import import_open3d
from ..core.scene import Float32, Float64
from ..geometry.convex_measures import convex_volume
from ..geometry.point_sets import measure_extent
from .view_objects import ViewObject, bolls_of_groups, find_objects, join_nearest

VOLUME_CAP: Final = 3.0
"""Largest convex hull of an object, in medians of all; an object of two touching bolls has more than twice as much."""
NOISE: Final = -1


def cluster_objects(
    lifted: LiftedMasks, means: Float32, up: Float64, eps: float = 0.4, min_samples: int = 10
) -> list[BollInstance]:
    """Bolls as density-connected objects of different views.

    Args:
        lifted: masks lifted onto the Gaussians.
        means: (N, 3) su.
        up: (3,) roughly upwards in the scene; only the numbering depends on it.
        eps: radius around a point that has to hold `min_samples` points, itself among them, in median widths of an
            object. A Gaussian that several objects hold counts as often.
    Returns:
        bolls, see `bolls_of_groups`.
    """
    points = np.asarray(means, np.float64)
    objects = drop_large(find_objects(lifted, points), points)
    if not objects:
        return []
    reach_su = eps * float(np.median([measure_extent(points[item.rows])[1][0] for item in objects]))
    members = find_clusters(objects, points, reach_su, min_samples)
    groups: list[list[ViewObject]] = []
    for cluster in sorted({member.cluster for member in members}):
        within = [member.item for member in members if member.cluster == cluster]
        groups += part_cluster(within, points, reach_su)
    return bolls_of_groups(groups, lifted, points, up)


def drop_large(objects: list[ViewObject], points: Float64) -> list[ViewObject]:
    """The objects whose convex hull is at most `VOLUME_CAP` medians; flat objects do not have a hull."""
    volumes = np.array([convex_volume(points[item.rows]).value for item in objects])
    if not np.isfinite(volumes).any():
        return []
    return [item for item, volume in zip(objects, volumes, strict=True) if volume <= VOLUME_CAP * np.nanmedian(volumes)]


@dataclass(frozen=True)
class Member:
    """An object, without its points that are noise, and the cluster of most of them."""

    item: ViewObject
    cluster: int


def find_clusters(objects: list[ViewObject], points: Float64, eps_su: float, min_samples: int) -> list[Member]:
    """DBSCAN over the points of all objects, without the objects whose points are all noise."""
    o3d = import_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.concatenate([points[item.rows] for item in objects])))
    labels = np.array(cloud.cluster_dbscan(eps_su, min_samples), np.int64)
    members = []
    for item, own in zip(objects, np.split(labels, np.cumsum([len(item.rows) for item in objects])[:-1]), strict=True):
        if (own > NOISE).any():
            cluster = int(np.bincount(own[own > NOISE]).argmax())
            kept = own == cluster
            members.append(Member(replace(item, rows=item.rows[kept], weights=item.weights[kept]), cluster))
    return members


def part_cluster(objects: list[ViewObject], points: Float64, eps_su: float) -> list[list[ViewObject]]:
    """One group if all objects come from different views; else several groups, each with one object a view at most."""
    view_of = np.array([item.view for item in objects])
    if len(np.unique(view_of)) == len(objects):
        return [objects]
    trees = [cKDTree(points[item.rows]) for item in objects]
    near = np.zeros((len(objects),) * 2, bool)
    for i, j in zip(*np.triu_indices(len(objects), 1), strict=True):
        gaps = trees[i].query(trees[j].data, distance_upper_bound=eps_su)[0]
        near[i, j] = near[j, i] = bool(np.isfinite(gaps).any())
    centres = np.array([measure_extent(points[item.rows])[0] for item in objects])
    groups = join_nearest(centres, view_of, lambda ours, theirs: bool(near[np.ix_(ours, theirs)].any()))
    return [[objects[k] for k in group] for group in groups]
