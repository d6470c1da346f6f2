"""Which lint belongs to one boll: touching bolls are divided, the four or five locks of one boll are not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32

SOLID = 0.6
"""Share of its boll's highest contrast at which a voxel counts as lint: half way down the edge, which ends above zero
because the views that look past a boll into another one see lint too."""
SMOOTHING = 0.15
"""Standard deviation, in boll diameters, that makes one hill of a boll; its locks are half a diameter apart."""
DIP = 0.87
"""Two hills are two bolls where the pass between them is lower than this share of the lower one."""
SMALLEST, LARGEST = 0.35, 2.0
"""Diameters of a ball of a boll's volume, relative to the plant's median boll."""
THINNEST = 0.25
"""Least ratio of a boll's shortest to its longest extent; paper, table edges and bright stems are thinner."""


def split_touching(contrasts: Float32, least: float) -> NDArray[np.int32]:
    """Divide a volume into bolls by a watershed on its smoothed contrast.

    Args:
        contrasts: (X, Y, Z), 1 = surely lint, 0 or less = not.
        least: contrast that the best voxel of a boll reaches.
    Returns:
        (X, Y, Z) 0 = no lint, 1 ... B.
    """
    from scipy import ndimage

    # The margin spares every look at a neighbour the question whether there is one.
    lint = np.pad(np.clip(contrasts, 0, 1), 1)
    diameter = typical_diameter(lint)
    hills = ndimage.gaussian_filter(lint, SMOOTHING * diameter)
    hills[0], hills[-1], hills[:, 0], hills[:, -1], hills[:, :, 0], hills[:, :, -1] = [0] * 6
    voxels = np.flatnonzero(hills > SOLID * least / 2)
    if not len(voxels):
        return np.zeros(contrasts.shape, np.int32)
    summits = _joined(_summits(hills, voxels), hills, voxels)
    highest = np.zeros(hills.size, np.float32)
    np.maximum.at(highest, summits, lint.ravel()[voxels])
    solid = (lint.ravel()[voxels] > SOLID * highest[summits]) & (highest[summits] > least)
    numbers = np.unique(summits[solid], return_inverse=True)[1]
    labels = np.zeros(hills.size, np.int32)
    labels[voxels[solid]] = numbers + 1
    return _boll_shaped(labels.reshape(hills.shape)[1:-1, 1:-1, 1:-1], diameter)


def typical_diameter(lint: Float32) -> float:
    """Median diameter, in voxels, of balls of the separate parts' volumes; a touching pair counts as 1.26 bolls."""
    from scipy import ndimage

    parts, _ = ndimage.label(lint > SOLID)
    volumes = np.bincount(parts.ravel())[1:]
    # Specks of one or two voxels a side are noise of single views.
    diameters = np.cbrt(6 / np.pi * volumes[volumes >= 27])
    return float(np.median(diameters)) if len(diameters) else 9.0


def _summits(hills: Float32, voxels: NDArray[np.int64]) -> NDArray[np.int64]:
    """The voxel (flat index) that steepest ascent from each of `voxels` ends at; of equals the later one is higher."""
    flat = hills.ravel()
    upward = np.arange(hills.size)
    for step in _steps(hills.shape):
        for ahead in (voxels + step, voxels - step):
            best = upward[voxels]
            higher = (flat[ahead] > flat[best]) | ((flat[ahead] == flat[best]) & (ahead > best))
            upward[voxels[higher]] = ahead[higher]
    summits = upward[voxels]
    while not np.array_equal(summits, upward[summits]):
        summits = upward[summits]
    return summits


def _joined(summits: NDArray[np.int64], hills: Float32, voxels: NDArray[np.int64]) -> NDArray[np.int64]:
    """`summits` with one for all hills whose pass is hardly lower than the lower one, highest pass first."""
    flat = hills.ravel()
    owner = np.full(hills.size, -1)
    owner[voxels] = summits
    passes: dict[tuple[int, int], float] = {}
    for step in _steps(hills.shape):
        ahead = voxels + step
        border = (owner[ahead] >= 0) & (owner[ahead] != summits)
        heights = np.minimum(flat[voxels], flat[ahead])[border]
        pairs = np.sort(np.stack([summits[border], owner[ahead[border]]], 1), axis=1)
        for (one, other), height in zip(pairs.tolist(), heights.tolist(), strict=True):
            passes[one, other] = max(passes.get((one, other), 0.0), height)
    parent = {int(summit): int(summit) for summit in np.unique(summits)}

    def top(summit: int) -> int:
        while parent[summit] != summit:
            summit = parent[summit]
        return summit

    for (one, other), height in sorted(passes.items(), key=lambda item: (-item[1], item[0])):
        low, high = sorted((top(one), top(other)), key=lambda summit: (flat[summit], summit))
        if low != high and height > DIP * flat[low]:
            parent[low] = high
    names, numbers = np.unique(summits, return_inverse=True)
    return np.array([top(int(summit)) for summit in names])[numbers]


def _steps(shape: tuple[int, ...]) -> list[int]:
    """Distances in flat index to half of a voxel's 26 neighbours; the other half lies opposite."""
    steps = [(x * shape[1] + y) * shape[2] + z for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    return [step for step in steps if step > 0]


def _boll_shaped(labels: NDArray[np.int32], diameter: float) -> NDArray[np.int32]:
    """Labels renumbered 1 ... B without those that are too small, too large or too thin to be bolls."""
    from scipy import ndimage

    volumes = np.bincount(labels.ravel())
    sizes = np.cbrt(6 / np.pi * volumes) / diameter
    kept = (sizes >= SMALLEST) & (sizes <= LARGEST)
    kept[0] = False
    # Each in its own box: a scene that is no plant may have thousands.
    boxes = ndimage.find_objects(labels)
    for label in np.flatnonzero(kept):
        voxels = np.argwhere(labels[boxes[label - 1]] == label)
        extents = np.sqrt(np.linalg.eigvalsh(np.cov(voxels.T) + np.eye(3) / 12))
        kept[label] = extents[0] >= THINNEST * extents[2]
    return np.where(kept, np.cumsum(kept), 0).astype(np.int32)[labels]
