# SPDX-License-Identifier: Apache-2.0
"""Finds the middles of bolls: the places in space where the votes of all views meet.

In one image touching bolls may look like one boll, and one boll like two. The votes from all sides agree only where
there is a boll. A vote is a place in space: the lint of the model gives the depth of the pixel, and the middle of the
boll lies somewhat deeper. How much deeper is a guess. Therefore each middle moves to the point that the rays of its
votes pass nearest; this point does not depend on any depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Final, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.network_maps import Maps
from ..core.scene import Camera, Float32, Float64
from ..geometry.point_sets import find_nearest, weighted_median
from .lint_in_space import LintInSpace

SPREAD: Final = 0.12
"""Standard deviation, in diameters of a boll, over which votes are gathered."""
PITCH: Final = 0.06
"""Side of the cells in which votes are counted, in diameters."""
APART: Final = 0.4
"""Least distance, in mean diameters, of the middles of two parts. Bolls that touch are 0.65 to 1 apart, locks of one
boll 0.4 to 0.8. Later steps join the parts of one boll; they cannot separate parts that are one here."""
LEAST_VIEWS: Final = 3
"""Least number of views that vote for a middle ..."""
LEAST_SUPPORT: Final = 0.02
"""... and least sum of their votes per view; a boll that is seen whole has 1."""
BLOCK: Final = 64
"""Cells along a side that are smoothed at a time; at least twice as many as the smoothing reaches."""
LEAST_SHARE: Final = 0.4
"""Least share of lint, rendered from the model, in a pixel that votes ..."""
LEAST_PROBABILITY: Final = 0.2
"""... and least probability of lint by the network: elsewhere its votes mean nothing."""
DEEPER: Final = 0.6
"""Depth of a boll's middle behind its visible lint, in the depths of a ball: the middles of Gaussians lie below the
surface that they show."""
OWN: Final = 0.45
"""Distance, in diameters, from a middle of the votes whose rays move it."""
AGREES: Final = 0.15
"""Distance, in diameters, from a middle at which a ray has half of its weight."""
ROUNDS: Final = 4
FAINT: Final = 0.08
"""A middle is not a boll if the sum of its votes per view is at most this ..."""
UNSURE: Final = 0.62
"""... and the views' mean probability of lint there is at most this. Segments of a pineapple had at most 0.07 and 0.58.
True bolls of the densest heap had 0.07 but 0.68, those of a leafy plant 0.13 but 0.63."""
FARTHEST: Final = 1.2
"""Largest distance of a boll's lint from its middle, in diameters. Half a diameter is not enough, because the network
underestimates sizes, those of large bolls most."""


@dataclass(frozen=True)
class Votes:
    """The votes of one view, one row for each pixel of lint."""

    places: Float32
    """(N, 3) su, of the boll's middle."""
    surfaces: Float32
    """(N, 3) su, of the lint that is seen."""
    rays: Float32
    """(N, 3) of unit length, from the eye to the middle."""
    eye: Float64
    """(3,) su."""
    diameters: Float32
    """(N,) su."""
    probabilities: Float32
    """(N,) of lint, by the view alone."""
    weights: Float32
    """(N,) their sum is 1 for a boll that the view sees whole."""

    def take(self, chosen: NDArray[np.bool_]) -> Votes:
        """Some of its rows (N,)."""
        rows = {item.name: getattr(self, item.name)[chosen] for item in fields(self) if item.name != "eye"}
        return replace(self, **rows)


@dataclass(frozen=True)
class Middles:
    """Bolls found by all views, the surest first."""

    centres: Float32
    """(B, 3) su."""
    diameters: Float32
    """(B,) su, median of the views' votes."""
    support: Float32
    """(B,) sum of the votes of all views; a view that sees the boll whole adds 1."""
    views: NDArray[np.int64]
    """(B,) views with votes for it."""

    def nearest(self, places: Float32) -> NDArray[np.uint16]:
        """(N,) number of the boll nearest to each of (N, 3) places, from 1; 0 = no boll is near."""
        return find_nearest(places, self.centres, self.diameters, FARTHEST)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Self:
        """Some of its rows (B,)."""
        return replace(self, **{item.name: getattr(self, item.name)[chosen] for item in fields(self)})

    def merged_with(self, others: Middles) -> Middles:
        """Both, the surest first."""
        rows = [np.concatenate([getattr(self, item.name), getattr(others, item.name)]) for item in fields(self)]
        both = Middles(*rows)
        return both.take(np.argsort(-both.support, kind="stable"))


def cast_votes(maps: Maps, camera: Camera, lint: LintInSpace) -> Votes:
    """The votes of one view.

    Args:
        camera: of the image that the maps are of.
    """
    height, width = maps.lint.shape
    small = camera.resized(width, height)
    share, seen = lint.seen(small)
    rows, columns = np.nonzero((share > LEAST_SHARE) & (maps.lint > LEAST_PROBABILITY))
    surfaces = seen[rows, columns]
    depths = (surfaces @ camera.rotation.T + camera.cam_from_scene[:, 3])[:, 2]
    votes_px = maps.votes[:, rows, columns].T / np.float32(maps.scale)
    diameters_px = maps.diameters[rows, columns] / np.float32(maps.scale)
    away_px = np.linalg.norm(votes_px - np.stack([columns + 0.5, rows + 0.5], axis=1), axis=1)
    su_of_px = depths / np.float32(small.fx)
    bulge = np.sqrt((0.25 * diameters_px**2 - away_px**2).clip(min=0)) * su_of_px
    across = (votes_px - (small.cx, small.cy)) / (small.fx, small.fy)
    in_camera = np.column_stack([across, np.ones(len(across))])
    rays = in_camera @ camera.rotation
    places = camera.centre + rays * (depths + DEEPER * bulge)[:, None]
    return Votes(
        places=places.astype(np.float32),
        surfaces=surfaces,
        rays=(rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32),
        eye=np.asarray(camera.centre, np.float64),
        diameters=(diameters_px * su_of_px).astype(np.float32),
        probabilities=maps.lint[rows, columns],
        weights=(maps.lint[rows, columns] / (np.pi / 4 * diameters_px**2)).astype(np.float32),
    )


def find_middles(votes: Sequence[Votes]) -> Middles:
    """Places where the votes of enough views meet.

    Args:
        votes: of each view.
    """
    from scipy.spatial import cKDTree

    nothing = Middles(
        np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros(0, np.float32), np.zeros(0, np.int64)
    )
    places = np.concatenate([view.places for view in votes])
    if not len(places):
        return nothing
    diameters = np.concatenate([view.diameters for view in votes])
    weights = np.concatenate([view.weights for view in votes])
    rays = np.concatenate([view.rays for view in votes])
    view_of = np.repeat(np.arange(len(votes)), [len(view.places) for view in votes])
    eyes = np.array([view.eye for view in votes])
    usual, least = weighted_median(diameters, weights), LEAST_SUPPORT * len(votes)
    inside, peaks = _find_peaks(places, weights, usual, least)
    places, diameters, weights, rays, view_of = (a[inside] for a in (places, diameters, weights, rays, view_of))
    tree = cKDTree(places)
    found: list[tuple[Float64, float, float, int]] = []
    for peak in peaks:
        place = peak
        for _ in range(3):
            near = np.array(tree.query_ball_point(place, 0.25 * usual), int)
            if not len(near):
                break
            place = np.average(places[near], axis=0, weights=weights[near])
        if not len(near):
            continue
        views = len(np.unique(view_of[near]))
        support = float(weights[near].sum())
        size = weighted_median(diameters[near], weights[near])
        if views < min(LEAST_VIEWS, len(votes)) or support < least or not _is_apart(place, size, found):
            continue
        own = np.array(tree.query_ball_point(place, OWN * size), int)
        place = meet_rays(eyes[view_of[own]], rays[own], weights[own], place, size)
        if _is_apart(place, size, found):
            found.append((place, size, support, views))
    if not found:
        return nothing
    found.sort(key=lambda item: -item[2])
    return Middles(
        centres=np.array([item[0] for item in found], np.float32),
        diameters=np.array([item[1] for item in found], np.float32),
        support=np.array([item[2] for item in found], np.float32),
        views=np.array([item[3] for item in found]),
    )


def _find_peaks(places: Float32, weights: Float32, usual: float, least: float) -> tuple[NDArray[np.bool_], Float64]:
    """Count the votes in a grid around nearly all of them.

    Args:
        usual: width of a boll, su.
        least: support of a boll.
    Returns:
        (N,) which votes the grid holds, and (P, 3) places where many meet, those with the most votes first.
    """
    low, high = _extent(places, weights, usual)
    inside = np.all((places >= low) & (places < high), axis=1)
    pitch = PITCH * usual
    cells = np.floor((places[inside] - low) / pitch).astype(int)
    peaks, heights = _peaks_of_cells(cells, weights[inside], SPREAD / PITCH, 0.2 * least)
    return inside, low + (peaks[np.lexsort((*peaks.T[::-1], -heights))] + 0.5) * pitch


def _peaks_of_cells(
    cells: NDArray[np.int64], weights: Float32, sigma: float, least: float
) -> tuple[NDArray[np.int64], Float32]:
    """Cells (P, 3) where the smoothed sum of the weights has a maximum of more than `least`, and its values (P,).

    Only blocks with votes are smoothed, so memory does not depend on the size of the plant. Each block has a margin as
    wide as the smoothing reaches, so the result does not depend on the blocks.

    Args:
        cells: (N, 3) of each vote. sigma: standard deviation of the smoothing, in cells.
    """
    # Smoothing reaches 4 standard deviations far, and a maximum is compared with the next cells.
    radius = int(4 * sigma + 0.5)
    margin = radius + 1
    # The scale makes the peak of votes that agree their sum. Votes spread as far as is allowed keep a fifth of it.
    kernel = cv2.getGaussianKernel(2 * radius + 1, sigma, cv2.CV_32F) * np.float32(np.sqrt(2 * np.pi) * sigma)
    # A vote is in its own block and reaches into the next one.
    blocks = cells.max(axis=0, initial=0) // BLOCK + 3
    reached = [(cells + margin * np.array(corner)) // BLOCK + 1 for corner in product((-1, 1), repeat=3)]
    numbers = np.unique([np.ravel_multi_index(tuple(some.T), blocks) for some in reached])
    found, heights = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.float32)]
    for block in np.column_stack(np.unravel_index(numbers, blocks)) - 1:
        first, side = block * BLOCK - margin, BLOCK + 2 * margin
        here = np.all((cells >= first) & (cells < first + side), axis=1)
        flat = np.ravel_multi_index(tuple((cells[here] - first).T), (side,) * 3)
        heat = np.bincount(flat, weights[here], minlength=side**3).reshape((side,) * 3).astype(np.float32)
        heat = _smooth(heat, kernel)
        peaks = np.argwhere(heat[margin:-margin, margin:-margin, margin:-margin] > least) + margin
        for step in product((-1, 0, 1), repeat=3):
            peaks = peaks[heat[tuple(peaks.T)] >= heat[tuple((peaks + step).T)]]
        heights.append(heat[tuple(peaks.T)])
        found.append(peaks - margin + block * BLOCK)
    return np.concatenate(found), np.concatenate(heights)


def _smooth(heat: Float32, kernel: Float32) -> Float32:
    """A cube (S, S, S) filtered by a kernel (K, 1) along each axis. OpenCV takes a fifth of the time of SciPy."""
    for _ in range(3):
        rows = np.ascontiguousarray(heat.reshape(len(heat), -1))
        filtered = cv2.sepFilter2D(rows, cv2.CV_32F, np.ones(1, np.float32), kernel)
        heat = filtered.reshape(heat.shape).transpose(1, 2, 0)
    return heat


def _is_apart(place: Float64, size: float, others: Sequence[tuple[Float64, float, float, int]]) -> bool:
    return all(np.linalg.norm(place - other) > APART * 0.5 * (size + own) for other, own, _, _ in others)


def meet_rays(eyes: Float64, rays: Float32, weights: Float32, place: Float64, size: float) -> Float64:
    """The point (3,) that rays (N, 3) from eyes (N, 3) pass nearest, by least squares. Far rays count less (Cauchy).

    Args:
        place: (3,) start. The point does not move along a direction that no ray crosses.
        size: of the boll, su.
    """
    across = np.eye(3) - rays[:, :, None].astype(np.float64) * rays[:, None, :]
    to_eyes = np.einsum("nij,nj->ni", across, eyes)
    moved = place
    for _ in range(ROUNDS):
        distances = np.linalg.norm(np.einsum("nij,j->ni", across, moved) - to_eyes, axis=1)
        trust = weights / (1 + (distances / (AGREES * size)) ** 2)
        matrix = np.einsum("n,nij->ij", trust, across)
        hold = 1e-3 * np.trace(matrix)
        moved = np.linalg.solve(matrix + hold * np.eye(3), trust @ to_eyes + hold * place)
    return moved


def find_faint(middles: Middles, votes: Sequence[Votes]) -> NDArray[np.bool_]:
    """Which middles (B,) have few votes, from pixels that hardly look like lint."""
    total, pixels = np.zeros(len(middles.centres) + 1), np.zeros(len(middles.centres) + 1)
    for view in votes:
        boll = middles.nearest(view.surfaces)
        total += np.bincount(boll, view.probabilities, len(total))
        pixels += np.bincount(boll, minlength=len(total))
    sure = total[1:] / np.maximum(pixels[1:], 1) > UNSURE
    return ~sure & (middles.support <= FAINT * len(votes))


def _extent(places: Float32, weights: Float32, usual: float) -> tuple[Float64, Float64]:
    """Corners of the box that holds nearly all votes."""
    bounds = []
    for axis in range(3):
        order = np.argsort(places[:, axis])
        share = np.cumsum(weights[order]) / weights.sum()
        bounds.append(places[order[np.searchsorted(share, [0.002, 0.998])], axis])
    box = np.array(bounds, np.float64)
    return box[:, 0] - usual, box[:, 1] + usual
