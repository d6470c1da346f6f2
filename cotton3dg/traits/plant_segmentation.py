# SPDX-License-Identifier: Apache-2.0
"""Which Gaussians are the plant: not the table, the clamp, the room or a floater. Thin branches are kept.

All lengths are in cm above the table, so this needs a scale.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.measurements import Scale
from ..core.scene import Float64, Gaussians, rotations
from .surface import MIN_OPACITY

MAX_LENGTH_CM: Final = 6.0
"""Two standard deviations of the longest Gaussian that may cover a straight piece of stem; the room's are larger."""
MAX_BREADTH_CM: Final = 3.0
"""The same across it."""
MARGIN_CM: Final = 25.0
"""How far branches may hang over the rim of the table."""
MAX_HEIGHT_CM: Final = 250.0
VOXEL_CM: Final = 0.8
"""Gaussians in the same or touching voxels are connected: about the thickness of a branch."""
BRIDGE_CM: Final = 3.0
"""Largest gap between the plant and a part of it, where the model lacks a thin branch."""
BOLL_BRIDGE_CM: Final = 6.0
"""The same gap for a boll."""
STANDING_CM: Final = 10.0
"""A boll beyond such a gap belongs to the plant only if all of it is higher than this above the table; then the model
only lacks its branch. A lower one, or one beside the table, is a fallen boll or another white thing."""
MIN_PART: Final = 4
"""Least number of Gaussians of a part beyond a gap; smaller parts are floaters."""
LOST_REACH_CM: Final = 12.0
"""Largest distance from the plant of solid specks in the air that may be the rest of a twig. Models that lack no twig
have hardly a speck: among 35 models of plants, specks changed the size of one, which lacked a twig of 20 cm."""
LOST_OPACITY: Final = 0.3
LOST_BREADTH_CM: Final = 0.5
"""Largest breadth of such specks. Twigs are covered by needles of a millimetre; floaters are as thick as a finger."""
LONELY: Final = 6
"""Largest number of other specks within a bridge's width; more are a separate thing beside the plant."""
MOST_LOST: Final = 12
"""Largest number of such specks. More come from a noisy model, as real photos give it, and not from twigs."""
STEM_LAYERS: Final = 8
"""Layers of 1 cm above the clamp in which the stem is searched."""
STEM_RADIUS_CM: Final = 1.5


@dataclass(frozen=True)
class Plant:
    """The plant among the Gaussians."""

    rows: NDArray[np.bool_]
    """(N,)"""
    foot: Float64
    """(3,) su, where the stem meets the table."""
    stem_found: bool
    """Whether a stem rises from the clamp. If not, the foot is the point below the middle of the plant."""
    apart: NDArray[np.bool_]
    """(N,) Gaussians of bolls that are not connected with the stem, and do not belong to the plant."""


def table_coordinates(scale: Scale, points: NDArray[Any]) -> Float64:
    """(N, 3) cm: x along the table's long side, y along the short one, from its middle; z height above the top."""
    level = (np.asarray(points, np.float64) - scale.corners.mean(axis=0)) @ scale.table_frame[:2].T * scale.cm_per_su
    return np.column_stack([level, scale.height_cm(points)])


def isolate_plant(
    gaussians: Gaussians, scale: Scale, clamp_height_cm: float, boll_of: NDArray[np.int64] | NDArray[np.bool_]
) -> Plant | None:
    """Find the plant: all that is connected with the stem above the clamp, and its bolls.

    Args:
        clamp_height_cm: height of the clamp that stands on the table and holds the plant.
        boll_of: (N,) boll of each Gaussian, 0 = none; without a stem all bolls belong to the plant.
    Returns:
        None if nothing stands on the table.
    """
    places, boll_rows = table_coordinates(scale, gaussians.means), boll_of > 0
    half = np.ptp(table_coordinates(scale, scale.corners)[:, :2], axis=0) / 2
    above = (np.abs(places[:, :2]) < half + MARGIN_CM).all(axis=1)
    kept = above.copy()
    # The clamp's Gaussians reach a little above it.
    floor_cm = clamp_height_cm + 1.0
    kept &= (places[:, 2] > floor_cm) & (places[:, 2] < MAX_HEIGHT_CM)
    kept &= gaussians.finite_rows & (gaussians.opacities >= MIN_OPACITY)
    extents_cm = np.sort(2 * gaussians.scales.astype(np.float64) * scale.cm_per_su, axis=1)
    kept &= (extents_cm[:, 2] < MAX_LENGTH_CM) & (extents_cm[:, 1] < MAX_BREADTH_CM)
    candidates = np.flatnonzero(kept | boll_rows)
    if not len(candidates):
        return None
    bolls, samples = boll_rows[candidates], _axis_points(gaussians[candidates], places[candidates], scale)
    standing = ~above | (places[:, 2] < STANDING_CM)
    high = boll_rows & ~np.isin(boll_of, boll_of[boll_rows & standing])
    # Mugs and tubes beside the plant may have more Gaussians than its stem, but do not hold bolls.
    holds = find_connected(samples, high[candidates]) if high.any() else np.ones(len(candidates), bool)
    stem = fit_stem_axis(places[candidates[holds & kept[candidates]]], floor_cm) or fit_stem_axis(
        places[kept], floor_cm
    )
    if stem is None:
        seeds = bolls if bolls.any() else np.ones(len(candidates), bool)
        base = np.append(np.median(places[candidates][seeds][:, :2], axis=0), 0.0)
    else:
        base, top = stem
        share = (places[candidates, 2] - base[2]) / (top[2] - base[2])
        away = places[candidates] - (base + share[:, None] * (top - base))
        beside = np.linalg.norm(away[:, :2], axis=1) < STEM_RADIUS_CM
        seeds = beside & (places[candidates, 2] < floor_cm + STEM_LAYERS)
        held = np.zeros(len(gaussians), bool)
        held[candidates] = find_connected(samples, seeds, BOLL_BRIDGE_CM)
        for boll in np.unique(boll_of[boll_rows]):
            own = boll_of == boll
            if held[own].mean() < 0.5 and standing[own].any():
                bolls &= ~own[candidates]
        seeds |= bolls
    rows = np.zeros(len(gaussians), bool)
    rows[candidates[find_connected(samples, seeds)]] = True
    apart = boll_rows.copy()
    apart[candidates[bolls]] = False
    rows &= ~apart
    frame = scale.table_frame
    foot = scale.corners.mean(axis=0) + base[:2] @ frame[:2] / scale.cm_per_su
    foot = foot - (foot @ scale.plane[:3] + scale.plane[3]) * scale.up
    return Plant(rows, foot, stem is not None, apart)


def fit_stem_axis(places: Float64, floor_cm: float) -> tuple[Float64, Float64] | None:
    """Where the stem's axis meets the table and where it leaves the layers above the clamp.

    Only the stem goes up through all layers: it is the place (within `STEM_RADIUS_CM`) where most layers of 1 cm have
    Gaussians. Among equal places the one with the most Gaussians counts. Its axis is fitted to the layers' medians and
    continued down.

    Args:
        places: (N, 3) cm.
    Returns:
        Two points (3,) cm, or None if nothing reaches through half of the layers.
    """
    from scipy.spatial import cKDTree

    low = places[(places[:, 2] >= floor_cm) & (places[:, 2] < floor_cm + STEM_LAYERS)]
    if len(low) < STEM_LAYERS:
        return None
    layers = (low[:, 2] - floor_cm).astype(int)
    # Stems lean, so they are searched around the lower layers' places, with room for 20 degrees.
    tree = cKDTree(low[:, :2])
    near = tree.query_ball_point(low[:, :2], STEM_RADIUS_CM)
    scores = [(len(set(layers[rows])), len(rows)) for rows in near]
    best = max(range(len(low)), key=lambda row: (*scores[row], -row))
    if scores[best][0] < STEM_LAYERS / 2:
        return None
    members, member_layers = low[near[best]], layers[near[best]]
    middles = np.array([np.median(members[member_layers == layer], axis=0) for layer in np.unique(member_layers)])
    slope, start = np.polyfit(middles[:, 2] - floor_cm, middles[:, :2], 1)
    ends = (-floor_cm, float(STEM_LAYERS))
    base, top = (np.append(start + slope * z, floor_cm + z) for z in ends)
    return base, top


def find_connected(samples: Float64, seeds: NDArray[np.bool_], bridge_cm: float = BRIDGE_CM) -> NDArray[np.bool_]:
    """Which bodies are connected with the seeds.

    Bodies whose samples share a voxel or lie in touching voxels form a part. Parts with a seed are taken; then, as long
    as there are any, parts of at least `MIN_PART` bodies within `bridge_cm` of the taken ones.

    Args:
        samples: (N, S, 3) cm, points that each of N bodies covers.
        seeds: (N,) at least one of them set.
    """
    from scipy.ndimage import label
    from scipy.spatial import cKDTree

    voxels = np.floor(samples / VOXEL_CM).astype(np.int64)
    voxels -= voxels.min(axis=(0, 1))
    grid = np.zeros(voxels.max(axis=(0, 1)) + 1, bool)
    grid[tuple(voxels.reshape(-1, 3).T)] = True
    # A body's own samples may lie voxels apart, so the part of its centre (the first sample) is its own.
    parts = label(grid, np.ones((3, 3, 3)))[0][tuple(voxels[:, 0].T)]
    sizes = np.bincount(parts)
    taken = np.isin(parts, parts[seeds])
    reached = taken
    while reached.any():
        rest = ~taken & (sizes[parts] >= MIN_PART)
        if not rest.any():
            break
        tree = cKDTree(samples[reached].reshape(-1, 3))
        gaps = tree.query(samples[rest].reshape(-1, 3), distance_upper_bound=bridge_cm)[0]
        close = np.isfinite(gaps).reshape(-1, samples.shape[1]).any(axis=1)
        reached = ~taken & np.isin(parts, parts[np.flatnonzero(rest)[close]])
        taken = taken | reached
    return taken


def find_lost_tips(gaussians: Gaussians, plant: Plant, scale: Scale, clamp_height_cm: float) -> NDArray[np.bool_]:
    """(N,) solid Gaussians that float in the air near the plant, few together and without support.

    Args:
        clamp_height_cm: as for `isolate_plant`.
    """
    from scipy.spatial import cKDTree

    places = table_coordinates(scale, gaussians.means)
    extents_cm = np.sort(2 * gaussians.scales.astype(np.float64) * scale.cm_per_su, axis=1)
    loose = gaussians.finite_rows & (gaussians.opacities >= LOST_OPACITY) & ~plant.rows & ~plant.apart
    loose &= (places[:, 2] > clamp_height_cm + 1.0) & (places[:, 2] < MAX_HEIGHT_CM)
    loose &= (extents_cm[:, 2] < MAX_LENGTH_CM) & (extents_cm[:, 1] < LOST_BREADTH_CM)
    specks = np.flatnonzero(loose)
    lost = np.zeros(len(gaussians), bool)
    if len(specks) and plant.rows.any():
        gaps = cKDTree(places[plant.rows]).query(places[specks], distance_upper_bound=LOST_REACH_CM)[0]
        near = specks[np.isfinite(gaps)]
        together = cKDTree(places[specks]).query_ball_point(places[near], BRIDGE_CM, return_length=True)
        lost[near[together <= 1 + LONELY]] = True
    return lost if lost.sum() <= MOST_LOST else np.zeros_like(lost)


def _axis_points(gaussians: Gaussians, places: Float64, scale: Scale) -> Float64:
    """(N, 7, 3) cm: the centre of each Gaussian and the ends of its axes at two standard deviations."""
    axes = np.swapaxes(rotations(gaussians.quats), 1, 2) * 2 * gaussians.scales[:, :, None] * scale.cm_per_su
    ends = axes @ scale.table_frame.T
    return np.concatenate([places[:, None], places[:, None] + ends, places[:, None] - ends], axis=1)
