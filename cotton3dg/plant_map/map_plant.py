# SPDX-License-Identifier: Apache-2.0
"""The map of a plant from its Gaussians, or from a scanner's points: wood, skeleton, order, thickness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ..core.measurements import Scale
from ..core.plant_map import PlantMap
from ..core.scene import Float64, Gaussians
from ..geometry.polylines import nearest_on, path_lengths
from .branch_confidence import lower_confidence
from .branching_order import draw_map
from .loops import open_loops
from .radii import radii_of
from .skeleton import SURFACE_CM, extract_axes, stem_radius
from .wood import classify, thinned, wood_places

CLOUD_SPACING_CM: Final = 0.25
LARGEST_CM: Final = 400.0
"""Largest height or width of a cotton plant. A larger cloud shows a room, and the graph of a room would be huge."""

BollPlace = tuple[int, Float64, float]
"""Id, centre (3,) and diameter of a boll, cm."""


def map_gaussians(
    wood: Gaussians,
    drawn: Gaussians,
    scale: Scale,
    foot: Float64,
    bolls: Sequence[BollPlace],
    opaque: float,
    trails: Sequence[Float64] = (),
) -> PlantMap:
    """The map of a trained plant.

    Args:
        wood: the plant's Gaussians without its bolls'. drawn: the same, as wide as they are drawn.
        foot: (3,) su, where the stem meets the table. opaque: opacity at which wood ends (`edges`).
        trails: (K, 3) cm each, places of twigs that the model lacks (`thin_twigs`).
    """
    plant_from_scene = scale.cm_from_scene
    drawn_map = map_places(np.vstack([wood_places(wood, plant_from_scene, foot), *trails]), bolls)
    radii = radii_of([axis.curve for axis in drawn_map.axes], drawn, plant_from_scene, foot, opaque)
    axes = tuple(replace(axis, radii=own) for axis, own in zip(drawn_map.axes, radii, strict=True))
    return replace(drawn_map, axes=axes)


def map_cloud(points_cm: Float64, bolls: Sequence[BollPlace]) -> PlantMap:
    """The map of a scanner's points (N, 3), without those of the bolls; they lie on the surface of the wood."""
    if len(points_cm) and np.ptp(points_cm, axis=0).max() > LARGEST_CM:
        return PlantMap((), (), "no_plant")
    drawn_map = map_places(thinned(points_cm, CLOUD_SPACING_CM), bolls)
    axes = tuple(replace(axis, radii=_surface_radii(axis.curve, points_cm)) for axis in drawn_map.axes)
    return replace(drawn_map, axes=axes)


def map_places(places: Float64, bolls: Sequence[BollPlace]) -> PlantMap:
    """The map of places (N, 3) cm where wood may be; thickness is left open."""
    cloud = classify(places, [boll for boll in bolls if np.isfinite(boll[1]).all() and np.isfinite(boll[2])])
    raw, meetings = extract_axes(cloud)
    if not raw:
        return PlantMap((), (), "no_stem")
    return lower_confidence(draw_map(cloud, open_loops(raw, meetings), stem_radius(raw[0].curve, places)))


def _surface_radii(curve: Float64, points: Float64) -> Float64:
    """(N,) median distance of the points beside each centimetre of a curve."""
    away, station = nearest_on(curve, points, SURFACE_CM)
    lengths = path_lengths(curve)
    middles = np.arange(0.5, max(lengths[-1], 0.6), 1.0)
    radii = np.array([
        np.median(near) if len(near := away[(away < SURFACE_CM) & (np.abs(station - middle) < 0.7)]) >= 5 else np.nan
        for middle in middles
    ])  # fmt: skip
    known = np.isfinite(radii)
    return np.interp(lengths, middles[known], radii[known]) if known.any() else np.full(len(curve), np.nan)
