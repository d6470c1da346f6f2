# SPDX-License-Identifier: Apache-2.0
"""Places that may be wood: those along the plant's Gaussians that are neither lint nor leaf.

Colour and shape decide: lint is known from the bolls, burs lie around them, and a leaf is broad where wood is a line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..core.scene import Float64, Gaussians, rotations

MIN_OPACITY: Final = 0.1
SPACING_CM: Final = 0.25
"""Spacing of places along the longest axis of a Gaussian, and side of the voxels that thin them."""
REACH: Final = 1.5
"""Length, in standard deviations, over which a Gaussian is followed along its longest axis."""
SHELL: Final = 1.25
"""Distance from the boll's middle, in its radii, within which the bur is hidden, ..."""
CARPELS: Final = 1.75
"""... and distance up to which its carpels spread: a path that ends there is not a branch."""
LEAF_CM: Final = 1.3
"""Radius of the neighbourhood that distinguishes a line from a blade."""
LEAF_BREADTH_CM: Final = 0.42
"""Standard deviation of places across the line from which they may be a blade, ..."""
LEAF_FLATNESS: Final = 0.72
"""... the largest share of it in the third direction of a blade (a thick stem is as broad, but round), ..."""
LEAF_PLACES: Final = 35
"""... and the least number of voxels of a blade there; lines that fork have fewer."""
RIM_CM: Final = 1.0
"""Distance of the rim of a blade from places that are broad on both sides."""
FOOT_CM: Final = 1.2
"""Distance from the foot of a boll within which wood goes on into the bur."""


@dataclass(frozen=True)
class BollBody:
    """A boll as the map needs it, cm."""

    boll_id: int
    centre: Float64
    diameter: float
    foot: Float64
    """(3,) end of its stalk, below the lint; NaN where no bur shows it."""


@dataclass(frozen=True)
class WoodCloud:
    """Places of a plant through which a skeleton may run, cm."""

    places: Float64
    """(N, 3)"""
    leaf: NDArray[np.bool_]
    """(N,) part of a blade."""
    bur: NDArray[np.int64]
    """(N,) id of the boll whose bur the place belongs to, 0 = none; wood at the foot of a boll belongs to none."""
    end: NDArray[np.bool_]
    """(N,) whether a branch may end there, which is neither in a blade nor at a bur."""
    bolls: tuple[BollBody, ...]


def wood_places(gaussians: Gaussians, plant_from_scene: Float64, foot: Float64) -> Float64:
    """(N, 3) cm: places along the Gaussians that may be wood.

    Args:
        plant_from_scene: (3, 3) rotation times cm per su. foot: (3,) su, origin of the plant frame.
    """
    opaque = gaussians[gaussians.finite_rows & (gaussians.opacities >= MIN_OPACITY)]
    if not len(opaque):
        return np.zeros((0, 3))
    longest = np.argmax(opaque.log_scales, axis=1)
    axes = rotations(opaque.quats)[np.arange(len(opaque)), :, longest]
    reach = REACH * opaque.scales.max(axis=1).astype(np.float64)[:, None] * axes @ plant_from_scene.T
    middles = (opaque.means - foot) @ plant_from_scene.T
    counts = np.clip(np.ceil(np.linalg.norm(reach, axis=1) / SPACING_CM).astype(int), 1, 20)
    rows = np.repeat(np.arange(len(opaque)), 2 * counts + 1)
    steps = np.arange(len(rows)) - np.repeat(np.cumsum(2 * counts + 1) - counts - 1, 2 * counts + 1)
    return thinned(middles[rows] + (steps / counts[rows])[:, None] * reach[rows], SPACING_CM)


def thinned(places: Float64, side: float) -> Float64:
    """(M, 3) the mean of the places in each voxel, in the order of the voxels."""
    if not len(places):
        return places
    voxels = np.floor(places / side).astype(np.int64)
    _, inverse, counts = np.unique(voxels, axis=0, return_inverse=True, return_counts=True)
    inverse = inverse.ravel()
    return np.column_stack([np.bincount(inverse, axis) for axis in places.T]) / counts[:, None]


def classify(places: Float64, bolls: list[tuple[int, Float64, float]]) -> WoodCloud:
    """Separate burs and blades from wood.

    Args:
        places: (N, 3) cm. bolls: id, centre (3,) and diameter of each, cm.
    """
    bur = np.zeros(len(places), np.int64)
    end = np.ones(len(places), bool)
    bodies = []
    for boll_id, centre, diameter in bolls:
        away = places - centre
        distances = np.linalg.norm(away, axis=1)
        shell = distances < SHELL * 0.5 * diameter
        end &= distances > CARPELS * 0.5 * diameter
        foot = np.full(3, np.nan)
        if shell.sum() >= 4:
            # The bur's carpels spread from the foot to all sides, so their middle lies on the boll's axis.
            way = away[shell].mean(axis=0)
            if np.linalg.norm(way) > 0.08 * diameter:
                foot = centre + 0.5 * diameter * way / np.linalg.norm(way)
        bodies.append(BollBody(boll_id, centre, diameter, foot))
        at_foot = np.linalg.norm(places - foot, axis=1) < FOOT_CM if np.isfinite(foot).all() else np.zeros(1, bool)
        bur[shell & ~at_foot] = boll_id
    leaf = _blades(places) & (bur == 0)
    if leaf.any():
        end &= cKDTree(places[leaf]).query(places)[0] > RIM_CM
    return WoodCloud(places, leaf, bur, end, tuple(bodies))


def _blades(places: Float64) -> NDArray[np.bool_]:
    """(N,) whether the neighbourhood is broad in two directions; single places in between go with their neighbours."""
    if len(places) < 4:
        return np.zeros(len(places), bool)
    pairs = cKDTree(places).query_pairs(LEAF_CM, output_type="ndarray")
    itself = np.arange(len(places))
    rows, near = (np.concatenate([itself, pairs[:, end], pairs[:, 1 - end]]) for end in (0, 1))
    others = places[near]
    counts = np.bincount(rows).astype(float)
    means = np.column_stack([np.bincount(rows, axis) for axis in others.T]) / counts[:, None]
    away = others - means[rows]
    spread = np.zeros((len(places), 3, 3))
    for i in range(3):
        for j in range(i, 3):
            spread[:, i, j] = spread[:, j, i] = np.bincount(rows, away[:, i] * away[:, j]) / counts
    thin, breadths = np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, :2], 0)).T
    broad = (breadths > LEAF_BREADTH_CM) & (thin < LEAF_FLATNESS * breadths)
    share = np.bincount(rows, broad[near]) / counts
    blades: NDArray[np.bool_] = (share > 0.5) & (counts >= LEAF_PLACES)
    return blades
