# SPDX-License-Identifier: Apache-2.0
"""Bolls of one image from the maps of the bolls' network.

Every pixel that looks like lint votes for the middle of its boll. There is a boll where votes meet; the pixels that
voted for it are its mask (Hough voting).
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.network_maps import Maps
from ..core.scene import Float32
from ..geometry.point_sets import find_nearest
from .bolls import OFFSET_PX

SURE: Final = 0.32
"""Probability of lint from which a pixel is lint."""
VOTE_SPREAD: Final = 0.10
"""Standard deviation, in diameters of the boll, over which votes for one middle are gathered."""
APART: Final = 0.55
"""Least distance, in diameters, of the middles of two bolls in an image, as one may stand partly before the other."""
LEAST_SHARE: Final = 0.06
"""Share of its disc that a boll must show."""
REACH: Final = 0.7
"""Farthest distance, in diameters, between a middle and a vote for it."""
MARGIN: Final = 48
"""Width, in pixels of the maps, of a frame around them. The search for middles includes the frame."""
OCTAVES: Final = range(-2, 4)
"""Sizes of bolls, as powers of two of `OFFSET_PX`, whose votes are gathered together."""


def group_votes(maps: Maps) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Bolls where votes meet, and the pixels that voted for each."""
    rows, columns = np.nonzero(maps.lint > SURE)
    ids = np.zeros(maps.lint.shape, np.uint16)
    if len(rows):
        votes = maps.votes[:, rows, columns].T
        middles, sizes = _find_middles(votes, maps.diameters[rows, columns], maps)
        ids[rows, columns] = find_nearest(votes, middles, sizes, REACH)
    return draw_ids(ids, maps)


def _find_middles(votes: Float32, diameters: Float32, maps: Maps) -> tuple[Float32, Float32]:
    """(B, 2) places where enough votes meet, most first, and (B,) the mean size by these votes; px."""
    # The middle of a boll that the image's edge cuts may lie beyond it.
    shape = (maps.lint.shape[0] + 2 * MARGIN, maps.lint.shape[1] + 2 * MARGIN)
    # The votes for a boll that is seen whole sum to 1.
    weights = (maps.scale**2 / (np.pi / 4 * diameters**2)).astype(np.float32)
    heat, sized = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    octaves = np.round(np.log2(diameters / (OFFSET_PX * maps.scale / 2))).clip(OCTAVES[0], OCTAVES[-1])
    x, y = (votes / maps.scale + MARGIN).T
    inside = (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])
    for octave in OCTAVES:
        chosen = inside & (octaves == octave)
        if not chosen.any():
            continue
        sigma = VOTE_SPREAD * OFFSET_PX * 2.0**octave / 2
        cells = np.ravel_multi_index((y[chosen].astype(int), x[chosen].astype(int)), shape)
        heat += _gather(cells, weights[chosen], shape, sigma)
        sized += _gather(cells, weights[chosen] * diameters[chosen], shape, sigma)
    rows, columns = np.nonzero((heat >= cv2.dilate(heat, np.ones((3, 3), np.uint8))) & (heat > LEAST_SHARE))
    order = np.argsort(-heat[rows, columns], kind="stable")
    rows, columns = rows[order], columns[order]
    places = ((np.stack([columns, rows], axis=1) + 0.5 - MARGIN) * maps.scale).astype(np.float32)
    sizes = (sized[rows, columns] / heat[rows, columns]).astype(np.float32)
    kept = suppress_non_maxima(places, sizes)
    return places[kept], sizes[kept]


def _gather(cells: NDArray[np.intp], values: Float32, shape: tuple[int, int], sigma: float) -> Float32:
    """(H, W) values summed over their neighbourhood. Values that agree give their sum at the peak."""
    part = np.bincount(cells, values, minlength=shape[0] * shape[1]).reshape(shape).astype(np.float32)
    gathered: Float32 = cv2.GaussianBlur(part, (0, 0), sigma) * np.float32(2 * np.pi * sigma**2)
    return gathered


def suppress_non_maxima(places: Float32, sizes: Float32) -> NDArray[np.intp]:
    """Which of (N, D) places, the surest first, keep the distance `APART`, in the larger size (N,), from surer ones."""
    from scipy.spatial import cKDTree

    if not len(places):
        return np.zeros(0, np.intp)
    tree = cKDTree(places)
    alive = np.ones(len(places), bool)
    kept = []
    for number, size in enumerate(sizes):
        if not alive[number]:
            continue
        kept.append(number)
        near = np.array(tree.query_ball_point(places[number], APART * max(float(size), float(sizes.max()))), int)
        far = np.linalg.norm(places[near] - places[number], axis=1)
        alive[near[far < APART * np.maximum(sizes[near], size)]] = False
    return np.array(kept, np.intp)


def draw_ids(ids: NDArray[np.uint16], maps: Maps) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Ids at the size of the image, and scores. Masks end where the interpolated probability of lint is `SURE`."""
    height, width = maps.image_shape
    size = (width, height)
    large = cv2.resize(ids, size, interpolation=cv2.INTER_NEAREST)
    lint = cv2.resize(maps.lint, size, interpolation=cv2.INTER_LINEAR)
    near = cv2.dilate(large, np.ones((5, 5), np.uint8))
    large = np.where(lint > SURE, np.where(large > 0, large, near), 0).astype(np.uint16)
    scores = {}
    for boll in np.unique(large[large > 0]):
        own = large == boll
        if own.sum() < 9:
            large[own] = 0
        else:
            scores[int(boll)] = round(float(lint[own].mean()), 3)
    return large, scores
