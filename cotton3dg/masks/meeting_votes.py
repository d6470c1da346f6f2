"""Where the votes of all views meet in space: bolls told apart by what every image says of their middles.

In one image touching bolls may look like one, and one like two; the middles that the network sees from all sides agree
only where there is a boll. A trained model tells how far each pixel is, so that its vote is a place in space: the
middle of the boll lies deeper than what is seen of it, by as much as a ball of the boll's size bulges there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float32, Float64, Gaussians
from ..splat import rasterizer
from .bolls import APART, SURE, Maps, ids_of_image, nearest_middles

SPREAD = 0.12
"""Standard deviation, in diameters of a boll, that votes are gathered over."""
PITCH = 0.08
"""Side of the cells that votes are counted in, in diameters."""
LEAST_VIEWS = 3
"""Views whose votes a middle needs ..."""
LEAST_SUPPORT = 0.04
"""... and their sum, in bolls seen whole, a view."""
LARGEST_GRID = 30_000_000
SEEN = 0.5
"""Least opacity of what a pixel shows."""


@dataclass(frozen=True)
class Votes:
    """What one view says, a row a pixel of lint."""

    pixels: tuple[NDArray[np.intp], NDArray[np.intp]]
    """Rows and columns in the view's maps."""
    places: Float32
    """(N, 3) su, of the boll's middle."""
    diameters: Float32
    """(N,) su."""
    weights: Float32
    """(N,) 1 in all for a boll that is seen whole."""


@dataclass(frozen=True)
class Middles:
    """Bolls found by all views, the surest first."""

    centres: Float32
    """(B, 3) su."""
    diameters: Float32
    """(B,) su, median of what the views say."""
    support: Float32
    """(B,) bolls seen whole, summed over views."""
    views: NDArray[np.int64]
    """(B,) views with votes for it."""


def votes_in_space(maps: Maps, camera: Camera, gaussians: Gaussians) -> Votes:
    """The votes of one view.

    Args:
        camera: of the image that the maps are of.
    """
    height, width = maps.lint.shape
    small = camera.resized(width, height)
    rendered = rasterizer.render_values(gaussians, small, np.ones((len(gaussians), 1), np.float32))
    solid = rendered.image[..., 0]
    rows, columns = np.nonzero((maps.lint > SURE) & (solid > SEEN))
    depths = rendered.depth[rows, columns]
    votes_px = maps.votes[:, rows, columns].T / np.float32(maps.scale)
    diameters_px = maps.diameters[rows, columns] / np.float32(maps.scale)
    away_px = np.linalg.norm(votes_px - np.stack([columns + 0.5, rows + 0.5], axis=1), axis=1)
    su_of_px = depths / np.float32(small.fx)
    bulge = np.sqrt((0.25 * diameters_px**2 - away_px**2).clip(min=0)) * su_of_px
    z = depths + bulge
    in_camera = np.stack(
        [(votes_px[:, 0] - small.cx) / small.fx * z, (votes_px[:, 1] - small.cy) / small.fy * z, z], axis=1
    )
    places = (in_camera - camera.cam_from_scene[:, 3]) @ camera.rotation
    weights = maps.lint[rows, columns] / (np.pi / 4 * diameters_px**2)
    return Votes((rows, columns), places.astype(np.float32), diameters_px * su_of_px, weights.astype(np.float32))


def find_middles(votes: Sequence[Votes]) -> Middles:
    """Places where the votes of enough views meet.

    Args:
        votes: of each view.
    """
    from scipy import ndimage
    from scipy.spatial import cKDTree

    nothing = Middles(
        np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros(0, np.float32), np.zeros(0, np.int64)
    )
    places = np.concatenate([view.places for view in votes])
    if not len(places):
        return nothing
    diameters = np.concatenate([view.diameters for view in votes])
    weights = np.concatenate([view.weights for view in votes])
    view_of = np.repeat(np.arange(len(votes)), [len(view.places) for view in votes])
    usual = _weighted_median(diameters, weights)
    low, high = _extent(places, weights, usual)
    pitch = max(PITCH * usual, float(np.cbrt((high - low).prod() / LARGEST_GRID)))
    shape = np.ceil((high - low) / pitch).astype(int) + 1
    cells = np.floor((places - low) / pitch).astype(int)
    inside = ((cells >= 0) & (cells < shape)).all(axis=1)
    places, diameters, weights, view_of, cells = (a[inside] for a in (places, diameters, weights, view_of, cells))
    heat = np.bincount(np.ravel_multi_index(tuple(cells.T), shape), weights, minlength=int(shape.prod()))
    heat = heat.reshape(shape).astype(np.float32)
    sigma = SPREAD * usual / pitch
    # Scaled so that votes that agree give their sum at the peak; spread as far as they may be, a fifth of it is left.
    heat = ndimage.gaussian_filter(heat, sigma) * np.float32((2 * np.pi) ** 1.5 * sigma**3)
    least = LEAST_SUPPORT * len(votes)
    peaks = np.argwhere((heat >= ndimage.maximum_filter(heat, 3)) & (heat > 0.2 * least))
    order = np.argsort(-heat[tuple(peaks.T)], kind="stable")
    tree = cKDTree(places)
    found: list[tuple[Float32, float, float, int]] = []
    for cell in peaks[order]:
        place = low + (cell + 0.5) * pitch
        for _ in range(3):
            near = np.array(tree.query_ball_point(place, 0.25 * usual), int)
            if not len(near):
                break
            place = np.average(places[near], axis=0, weights=weights[near])
        if not len(near):
            continue
        views = len(np.unique(view_of[near]))
        support = float(weights[near].sum())
        size = _weighted_median(diameters[near], weights[near])
        apart = all(np.linalg.norm(place - other) > APART * max(size, own) for other, own, _, _ in found)
        if apart and views >= min(LEAST_VIEWS, len(votes)) and support >= least:
            found.append((place.astype(np.float32), size, support, views))
    if not found:
        return nothing
    found.sort(key=lambda item: -item[2])
    return Middles(
        centres=np.array([item[0] for item in found]),
        diameters=np.array([item[1] for item in found], np.float32),
        support=np.array([item[2] for item in found], np.float32),
        views=np.array([item[3] for item in found]),
    )


def painted(maps: Maps, votes: Votes, middles: Middles) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Masks in one image: each pixel of lint belongs to the middle that its vote is nearest to.

    Returns:
        ids (H, W), 1 ... B in the order of `middles`, 0 = none; and each boll's score.
    """
    ids = np.zeros(maps.lint.shape, np.uint16)
    ids[votes.pixels] = nearest_middles(votes.places, middles.centres, middles.diameters)
    return ids_of_image(ids, maps)


def _extent(places: Float32, weights: Float32, usual: float) -> tuple[Float64, Float64]:
    """Corners of the box that holds nearly all votes."""
    bounds = []
    for axis in range(3):
        order = np.argsort(places[:, axis])
        share = np.cumsum(weights[order]) / weights.sum()
        bounds.append(places[order[np.searchsorted(share, [0.002, 0.998])], axis])
    box = np.array(bounds, np.float64)
    return box[:, 0] - usual, box[:, 1] + usual


def _weighted_median(values: Float32, weights: Float32) -> float:
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(share, 0.5 * share[-1])]])
