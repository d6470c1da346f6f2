# SPDX-License-Identifier: Apache-2.0
"""Dense starting points: optical flow between neighbouring images, triangulated with the known cameras.

Structure from motion leaves a few points on plain surfaces and thin branches. Starting from many well-placed points
instead saves most of the densification (EDGS, Kotovenko et al. 2025), at some ten milliseconds an image pair.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.machine import on_all_cores
from ..core.scene import Camera
from ..gaussians.views import View
from .random_streams import open_stream

FLOW_SIDE_PX: Final = 480
"""Longer side of the images that flow is computed on."""

BEST_PARALLAX_DEG: Final = 6.0
"""Angle between the two cameras of a pair seen from a near point: depth is well determined, appearance still alike."""

NEAR_QUANTILE: Final = 0.2
"""Quantile of the depths that stands for a near point: the plant is in front of the room."""

NEIGHBOURS: Final = 3
"""Cameras that each camera is paired with; a point needs the agreement of two pairs."""

CONSISTENT_PX: Final = 1.0
"""Largest error of forward-backward flow and of reprojection, px of the flow image."""

CONSISTENT_DEPTH: Final = 0.03
"""Largest relative difference between the depths from two pairs."""

SMALLEST_SIDE_PX: Final = 32
"""DIS refuses images that are not much larger than its patches."""

GRID_PX: Final = 4
"""Distance of the sampled pixels in the flow image."""


def find_dense_points(
    views: Sequence[View], points: NDArray[Any], count: int, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Points on the surfaces on which two or more pairs of images agree.

    Args:
        views: photos with their cameras.
        points: (N, 3) some points of the scene, su; they give its distance.
        count: largest number of points, which are drawn at random.
        seed: of the draw.
    Returns:
        (M, 3) points, su, and (M, 3) uint8 colours; M may be 0.
    """
    import cv2

    small = on_all_cores(lambda view: view.limited(FLOW_SIDE_PX), views)
    grey = [cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY) for view in small]

    def depths_of(pair: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        (first, second), (image, other) = (small[i].camera for i in pair), (grey[i] for i in pair)
        forward, backward = flow.calc(image, other, None), flow.calc(other, image, None)
        return _depths(first, second, forward, backward), _depths(second, first, backward, forward)

    neighbours = find_neighbouring_pairs([view.camera for view in views], points)
    pairs = [(i, j) for i, j in neighbours if grey[i].shape == grey[j].shape and min(grey[i].shape) >= SMALLEST_SIDE_PX]
    depths: list[list[NDArray[np.float64]]] = [[np.full(len(_grid(view.camera)), np.nan)] for view in small]
    for pair, found_by in zip(pairs, on_all_cores(depths_of, pairs), strict=True):
        for i, estimate in zip(pair, found_by, strict=True):
            depths[i].append(estimate)
    found, colours = [np.zeros((0, 3))], [np.zeros((0, 3), np.uint8)]
    for view, estimates in zip(small, depths, strict=True):
        camera, depth, pixels = view.camera, _agree(estimates), _grid(view.camera)
        pixels, depth = pixels[np.isfinite(depth)], depth[np.isfinite(depth)]
        found.append((camera.rays(pixels) * depth[:, None] - camera.cam_from_scene[:, 3]) @ camera.rotation)
        colours.append(view.image[pixels[:, 1].astype(int), pixels[:, 0].astype(int)])
    xyz, rgb = np.concatenate(found), np.concatenate(colours)
    if len(xyz) > count:
        chosen = np.sort(open_stream(seed, "dense points").choice(len(xyz), count, replace=False))
        xyz, rgb = xyz[chosen], rgb[chosen]
    return xyz, rgb


def find_neighbouring_pairs(cameras: Sequence[Camera], points: NDArray[Any]) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, of cameras with nearly BEST_PARALLAX_DEG between them and a common view."""
    centres = np.array([camera.centre for camera in cameras])
    forwards = np.array([camera.forward for camera in cameras])
    sample = np.asarray(points, np.float64)[:: max(1, len(points) // 1000)]
    pairs = set()
    for i, camera in enumerate(cameras):
        depths = sample @ camera.forward - camera.centre @ camera.forward
        if not (depths > 0).any():
            continue
        near = np.quantile(depths[depths > 0], NEAR_QUANTILE)
        parallax = np.degrees(np.arctan2(np.linalg.norm(centres - camera.centre, axis=1), near))
        turned = np.degrees(np.arccos(np.clip(forwards @ camera.forward, -1.0, 1.0)))
        # Logarithmic, so that half the angle is as bad as twice.
        badness = np.abs(np.log(np.maximum(parallax, 1e-3) / BEST_PARALLAX_DEG))
        usable = (parallax > BEST_PARALLAX_DEG / 4) & (np.maximum(parallax, turned) < 4 * BEST_PARALLAX_DEG)
        best = [int(j) for j in np.argsort(badness, kind="stable") if usable[j] and j != i]
        pairs |= {(min(i, j), max(i, j)) for j in best[:NEIGHBOURS]}
    return sorted(pairs)


def _grid(camera: Camera) -> NDArray[np.float64]:
    """(P, 2) centres of the sampled pixels."""
    y, x = np.mgrid[GRID_PX // 2 : camera.height : GRID_PX, GRID_PX // 2 : camera.width : GRID_PX]
    return np.stack([x.ravel(), y.ravel()], axis=1) + 0.5


def _depths(first: Camera, second: Camera, forward: NDArray[Any], backward: NDArray[Any]) -> NDArray[np.float64]:
    """(P,) depth in `first` of its grid pixels, su; NaN where flow and cameras do not agree.

    The depth is the least-squares solution of the two rays being parallel (linear triangulation); it counts if its
    projection is within CONSISTENT_PX of where the flow leads.
    """
    pixels = _grid(first)
    columns, rows = pixels.astype(int).T
    there = pixels + forward[rows, columns]
    inside = (there >= 0).all(axis=1) & (there[:, 0] < second.width) & (there[:, 1] < second.height)
    columns_there, rows_there = np.where(inside[:, None], there, 0).astype(int).T
    returned = there + backward[rows_there, columns_there]
    # In the second camera a point at depth d lies at d·a + b, parallel to the ray r: r × (d·a + b) = 0.
    second_from_first = second.rotation @ first.rotation.T
    a = first.rays(pixels) @ second_from_first.T
    b = second.cam_from_scene[:, 3] - second_from_first @ first.cam_from_scene[:, 3]
    ray = second.rays(there)
    ra, rb = np.cross(ray, a), np.cross(ray, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -(ra * rb).sum(axis=1) / (ra * ra).sum(axis=1)
        seen = a * depth[:, None] + b
        error = seen[:, :2] / seen[:, 2:] * (second.fx, second.fy) + (second.cx, second.cy) - there
        good = inside & (depth > 0) & (seen[:, 2] > 0) & (np.linalg.norm(error, axis=1) < CONSISTENT_PX)
        good &= np.linalg.norm(returned - pixels, axis=1) < CONSISTENT_PX
    return np.where(good, depth, np.nan)


def _agree(estimates: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """(P,) median of the depths on which at least two estimates agree, else NaN."""
    stacked = np.stack(estimates)
    counted = np.isfinite(stacked).sum(axis=0)
    median = np.nanmedian(np.where(counted > 0, stacked, 0.0), axis=0)
    with np.errstate(invalid="ignore"):
        agreeing = np.abs(stacked - median) <= CONSISTENT_DEPTH * median
    return np.where(agreeing.sum(axis=0) >= 2, median, np.nan)
