"""Which lint belongs to one boll: touching bolls are divided, the four or five locks of one boll are not."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32

SOLID: Final = 0.8
"""Share of its boll's highest contrast at which a voxel counts as lint: near the top of the edge, which spreads
outwards because the views that look past a boll into another one, or onto a white wall, see lint too."""
HALF: Final = 0.6
"""Contrast half way down that edge, whose surface encloses about the volume of a boll."""
LEVELS: Final = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
"""Contrasts whose surfaces give the depth of a voxel inside of lint. The necks between bolls show in some of them only,
the lower the deeper the bolls stand in a heap."""
SMOOTHING: Final = 0.1
"""Standard deviation, in boll diameters, that levels the ripples of depths that voxels and locks make."""
DIP: Final = 0.97
"""Two hills are two bolls where the pass between them is lower than this share of the lower one ..."""
LOCKS_APART: Final = 0.55
LOCKS_DIP: Final = 0.5
"""... or than this one, when they are closer than so many boll diameters: the four or five locks of an open boll are
half a diameter apart."""
LARGEST_HEAP: Final = 1000
"""Largest volume of connected lint, in typical bolls. A larger one is a room, not a plant, and not worth the time."""
SMALLEST: Final = 0.35
LARGEST: Final = 2.0
"""Diameters of a ball of a boll's volume, relative to the plant's median boll."""
THINNEST: Final = 0.25
"""Least ratio of a boll's shortest to its longest extent; paper, table edges and bright stems are thinner ..."""
CAP_THICKNESS: Final = 1 / 3
CAP_ROUNDNESS: Final = 0.6
CAP_APART: Final = 1.0
"""... but of a boll that its bur hides from below only a flat cap is seen: at least so thick, relative to the extent of
a typical boll, its second extent at least so long, relative to its longest, and so many diameters from other bolls, for
else it is a lock of one of them."""


def split_touching(contrasts: Float32, least: float) -> NDArray[np.int32]:
    """Divide a volume into bolls by a watershed on the depth inside of lint, which is least where two bolls touch.

    Args:
        contrasts: (X, Y, Z), 1 = surely lint, 0 or less = not.
        least: contrast that the best voxel of a boll reaches.
    Returns:
        (X, Y, Z) 0 = no lint, 1 ... B.
    """
    from scipy import ndimage

    lint = np.clip(contrasts, 0, 1)
    diameter = typical_diameter(lint)
    heaps, _ = ndimage.label(lint > LEVELS[0])
    worth_it = np.bincount(heaps.ravel()) <= LARGEST_HEAP * np.pi / 6 * diameter**3
    labels, count = np.zeros(lint.shape, np.int32), 0
    for heap, box in enumerate(ndimage.find_objects(heaps), start=1):
        own = np.where(heaps[box] == heap, lint[box], 0)
        if worth_it[heap] and own.max() > least:
            # With the margin every voxel has all its neighbours, so no look at one needs a check of the bounds.
            bolls = _divide(np.pad(own, 1), least, diameter)[1:-1, 1:-1, 1:-1]
            labels[box] += np.where(bolls > 0, bolls + count, 0)
            count += int(bolls.max())
    return boll_shaped(labels, diameter)


def _divide(lint: Float32, least: float, diameter: float) -> NDArray[np.int32]:
    """Divide one heap of connected lint in the same way; its bolls may still have any size and shape."""
    from scipy import ndimage

    depths = sum(ndimage.distance_transform_edt(lint > level) for level in LEVELS) / len(LEVELS)
    hills = ndimage.gaussian_filter(depths, SMOOTHING * diameter, mode="constant").astype(np.float32)
    voxels = np.flatnonzero(lint > LEVELS[0])
    summits = _join(_summits(hills, voxels), hills, voxels, diameter)
    highest = np.zeros(hills.size, np.float32)
    np.maximum.at(highest, summits, lint.ravel()[voxels])
    solid = (lint.ravel()[voxels] > SOLID * highest[summits]) & (highest[summits] > least)
    labels = np.zeros(hills.size, np.int32)
    labels[voxels[solid]] = np.unique(summits[solid], return_inverse=True)[1] + 1
    return labels.reshape(lint.shape)


def typical_diameter(lint: Float32) -> float:
    """Median diameter, in voxels, of balls of the separate parts' volumes; a touching pair counts as 1.26 bolls."""
    from scipy import ndimage

    parts, _ = ndimage.label(lint > HALF)
    volumes = np.bincount(parts.ravel())[1:]
    # Specks of one or two voxels a side are noise of single views.
    diameters = np.cbrt(6 / np.pi * volumes[volumes >= 27])
    return float(np.median(diameters)) if len(diameters) else 9.0


def _summits(hills: Float32, voxels: NDArray[np.int64]) -> NDArray[np.int64]:
    """The voxel (flat index) at which steepest ascent from each of `voxels` ends; the later of two equals is higher."""
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


def _join(summits: NDArray[np.int64], hills: Float32, voxels: NDArray[np.int64], diameter: float) -> NDArray[np.int64]:
    """`summits` with one summit for all hills of a boll; the hills with the highest pass join first."""
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
    names, numbers = np.unique(summits, return_inverse=True)
    places = dict(zip(names.tolist(), np.stack(np.unravel_index(names, hills.shape), 1), strict=True))
    parent = {int(summit): int(summit) for summit in names}

    def top(summit: int) -> int:
        while parent[summit] != summit:
            summit = parent[summit]
        return summit

    for (one, other), height in sorted(passes.items(), key=lambda item: (-item[1], item[0])):
        low, high = sorted((top(one), top(other)), key=lambda summit: (flat[summit], summit))
        near = np.linalg.norm(places[one] - places[other]) < LOCKS_APART * diameter
        if low != high and height > (LOCKS_DIP if near else DIP) * flat[low]:
            parent[low] = high
    return np.array([top(int(summit)) for summit in names])[numbers]


def _steps(shape: tuple[int, ...]) -> list[int]:
    """Distances in flat index to half of a voxel's 26 neighbours; the other half lies opposite."""
    steps = [(x * shape[1] + y) * shape[2] + z for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    return [step for step in steps if step > 0]


def boll_shaped(labels: NDArray[np.int32], diameter: float) -> NDArray[np.int32]:
    """Labels renumbered 1 ... B without those that are too small, too large or too thin to be bolls.

    Args:
        labels: (X, Y, Z), 0 = no lint.
        diameter: of a typical boll, voxels.
    """
    from scipy import ndimage

    volumes = np.bincount(labels.ravel())
    sizes = np.cbrt(6 / np.pi * volumes) / diameter
    typical_extent = diameter / np.sqrt(20)  # of a ball, as standard deviation
    kept = (sizes >= SMALLEST) & (sizes <= LARGEST)
    kept[0] = False
    # Each boll has its own box: a scene that is not a plant may have thousands.
    boxes = ndimage.find_objects(labels)
    centres, caps = np.zeros((len(kept), 3)), []
    for label in np.flatnonzero(kept):
        box = boxes[label - 1]
        voxels = np.argwhere(labels[box] == label)
        centres[label] = voxels.mean(axis=0) + [side.start for side in box]
        extents = np.sqrt(np.linalg.eigvalsh(np.cov(voxels.T) + np.eye(3) / 12))
        kept[label] = extents[0] >= THINNEST * extents[2]
        if extents[0] >= CAP_THICKNESS * typical_extent and extents[1] >= CAP_ROUNDNESS * extents[2]:
            caps.append(label)
    for cap in sorted(caps, key=lambda label: (-volumes[label], label)):
        distances = np.linalg.norm(centres[kept] - centres[cap], axis=1)
        kept[cap] |= bool((distances > CAP_APART * diameter).all())
    return np.where(kept, np.cumsum(kept), 0).astype(np.int32)[labels]
