"""Where lint is around the plant: no image can decide that alone, so the images vote in space.

A white poster behind the plant looks like lint in one image and not in the next; a place in space where most views see
lint is lint. This is shape from silhouette (Laurentini 1994) with soft silhouettes, and with votes in place of an
intersection, because burs and branches hide every boll from some side. Lengths are relative to the radius R of
the orbit, because nothing has a unit yet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float32, Float64
from ..geometry.camera_orbit import Orbit, azimuths
from .split_touching import split_touching

REACH: Final = 0.4
"""Radius of the searched space, R: walls and shelves stand outside the circle of the cameras, plants well inside."""
COARSE: Final = 0.01
"""Pitch of the first search, R: a boll of 4-5 cm filmed from 1.3-1.6 m is three voxels wide."""
REFINED: Final = 3
"""Fine voxels along a coarse one."""
IN_VIEW: Final = 0.6
"""Least share of the views that have a voxel in their image; the plant is meant to be in all."""
CONTRAST: Final = 0.8
"""Least contrast of a boll's best voxels: the share of an arc's views that see lint there, beyond those that see white
through empty space anyway."""
SECTORS: Final = 6
ARC: Final = 4
"""The orbit's sectors and how many of them, side by side, have a vote of their own; the best one counts. What a boll
hangs on hides it from one side, and half a turn shows as much of its outline as a whole one; an arc of two thirds
holds that half, while a white wall shines through empty space from half a turn at most."""
LEAST_ROOM: Final = 0.25
"""Least share of the views with another background than white that a full contrast takes."""
CLEARANCE: Final = 0.04
"""Height above the table below which nothing is a boll, R: the clamp, labels, fallen locks."""
GROWTH: Final = 4
"""Voxels by which a boll may grow when its first masks vote again."""
AGREED: Final = 0.8
"""Share of its boll's highest vote that a voxel keeps. Views all around a ball see it through a point just outside it,
unless they look past; so nearly all must agree, but for those that burs and branches block."""


@dataclass(frozen=True)
class LintVolume:
    """Voxels that are lint, each of one boll."""

    voxels: NDArray[np.int64]
    """(N, 3) indices in the grid."""
    scene_from_voxel: Float64
    """(3, 4) affine."""
    bolls: NDArray[np.int32]
    """(N,) 1 ... B."""
    contrasts: Float32
    """(N,) 1 where all views see lint, 0 where as many see white as through the empty space around."""

    @property
    def centres(self) -> Float32:
        """(N, 3) su."""
        return _map(self.voxels.astype(np.float32), self.scene_from_voxel)

    @property
    def pitch(self) -> float:
        """su."""
        return float(np.linalg.norm(self.scene_from_voxel[:, 0]))

    def confidence(self, boll: int) -> float:
        """0..1, the highest contrast in a boll."""
        return float(np.clip(self.contrasts[self.bolls == boll].max(), 0, 1))


def find_bolls(
    scores: Sequence[NDArray[Any]], cameras: Sequence[Camera], orbit: Orbit, table: Float64 | None = None
) -> LintVolume:
    """Find the lint inside the orbit and divide it into bolls.

    Args:
        scores: (H, W) of each view, 0..1, how much each pixel looks like lint.
        cameras: of these views.
        table: (4,) plane, height above it = a x + b y + c z + d; None when there is none.
    """
    contrasts, scene_from_voxel = vote(scores, cameras, orbit, table)
    labels = split_touching(contrasts, CONTRAST)
    voxels = np.argwhere(labels > 0)
    where = tuple(voxels.T)
    return LintVolume(voxels, scene_from_voxel, labels[where], contrasts[where])


def refine_bolls(volume: LintVolume, masks: Sequence[NDArray[Any]], cameras: Sequence[Camera]) -> LintVolume:
    """The same bolls in the shape on which their first masks agree.

    Unlike colours alone, masks know what is near a boll: they follow lint into its shade and leave out the white wall
    behind it.

    Args:
        masks: (H, W) ids of each view; it does not matter of which boll.
        cameras: of these views.
    """
    from scipy import ndimage

    if not len(volume.voxels):
        return volume
    first = volume.voxels.min(axis=0) - GROWTH
    labels = np.zeros(np.ptp(volume.voxels, axis=0) + 2 * GROWTH + 1, np.int32)
    labels[tuple((volume.voxels - first).T)] = volume.bolls
    away, nearest = ndimage.distance_transform_edt(labels == 0, return_indices=True)
    near = np.argwhere(away <= GROWTH)
    bolls = labels[tuple(nearest[:, *near.T])]
    points = _map((near + first).astype(np.float32), volume.scene_from_voxel)
    shares, in_view = mean_score(points, [(ids > 0).astype(np.float32) for ids in masks], cameras)
    shares *= in_view
    highest = np.zeros(volume.bolls.max() + 1, np.float32)
    np.maximum.at(highest, bolls, shares)
    kept = (shares > 0) & (shares >= AGREED * highest[bolls])
    return LintVolume(near[kept] + first, volume.scene_from_voxel, bolls[kept], shares[kept])


def vote(
    scores: Sequence[NDArray[Any]], cameras: Sequence[Camera], orbit: Orbit, table: Float64 | None
) -> tuple[Float32, Float64]:
    """Contrasts (X, Y, Z) of fine voxels, 0 where nothing is to be expected, and the affine map (3, 4) of their indices
    into the scene. Arguments as of `find_bolls`.
    """
    from scipy import ndimage

    axis = orbit.axis if table is None else np.asarray(table[:3])
    pitch = COARSE * orbit.radius
    half = round(REACH / COARSE)
    scene_from_cell = np.column_stack([pitch * _level_axes(axis).T, orbit.centre])
    cells = np.stack(np.meshgrid(*[np.arange(-half, half + 1, dtype=np.float32)] * 3, indexing="ij"), -1)
    allowed = np.hypot(cells[..., 0], cells[..., 1]) <= half
    if table is not None:
        height = _map(cells, scene_from_cell) @ table[:3].astype(np.float32) + np.float32(table[3])
        allowed &= height > CLEARANCE * orbit.radius
    arcs = _arcs(cameras, orbit)
    shares, in_view = _mean_scores(_map(cells[allowed], scene_from_cell), scores, cameras, arcs)
    within = in_view >= IN_VIEW
    allowed[allowed] = within
    usual = np.stack([_usual_share(share, allowed) for share in shares[:, within]])
    hopeful = np.zeros(allowed.shape, bool)
    hopeful[allowed] = (_contrast(shares[:, within], usual) > CONTRAST / 2).any(axis=0)
    hopeful = ndimage.binary_dilation(hopeful) & allowed
    coarse = np.argwhere(hopeful)
    if not len(coarse):
        return np.zeros((1, 1, 1), np.float32), scene_from_cell

    corner = coarse.min(axis=0)
    thirds = np.stack(np.meshgrid(*[np.arange(REFINED)] * 3, indexing="ij"), -1).reshape(-1, 3)
    fine = ((coarse - corner)[:, None] * REFINED + thirds).reshape(-1, 3)
    first = corner - half + (1 - REFINED) / (2 * REFINED)
    scene_from_voxel = np.column_stack(
        [scene_from_cell[:, :3] / REFINED, scene_from_cell[:, :3] @ first + scene_from_cell[:, 3]]
    )
    shares, in_view = _mean_scores(_map(fine.astype(np.float32), scene_from_voxel), scores, cameras, arcs)
    contrasts = np.zeros((coarse.max(axis=0) - corner + 1) * REFINED, np.float32)
    best = _contrast(shares, np.repeat(usual[:, hopeful[allowed]], REFINED**3, axis=1)).max(axis=0)
    # A view that does not see a voxel does not vote on it.
    contrasts[tuple(fine.T)] = in_view * best
    return contrasts, scene_from_voxel


def _arcs(cameras: Sequence[Camera], orbit: Orbit) -> NDArray[np.bool_]:
    """(A, V) which views lie in each arc of the orbit; arcs with fewer than half of the views do not count."""
    sectors = (azimuths(cameras, orbit) * SECTORS / (2 * np.pi)).astype(np.int64) % SECTORS
    arcs = (sectors - np.arange(SECTORS)[:, None]) % SECTORS < ARC
    counted: NDArray[np.bool_] = arcs[2 * arcs.sum(axis=1) >= len(cameras)]
    return counted


def _mean_scores(
    points: Float32, scores: Sequence[NDArray[Any]], cameras: Sequence[Camera], arcs: NDArray[np.bool_]
) -> tuple[Float32, Float32]:
    """(A, N) mean score of (N, 3) points over the views of each arc that have them in their image, and the (N,) share
    of all views that do.
    """
    total, seen = np.zeros((2, len(arcs), len(points)), np.float32)
    in_view = np.zeros(len(points), np.float32)
    for score, camera, in_arc in zip(scores, cameras, arcs.T, strict=True):
        columns, lines, inside = pixels_of(points, camera)[:3]
        found = np.where(inside, score[lines, columns], 0).astype(np.float32)
        in_view += inside
        for arc in np.flatnonzero(in_arc):
            total[arc] += found
            seen[arc] += inside
    return (total / np.maximum(seen, 1)).astype(np.float32), in_view / np.float32(max(len(cameras), 1))


def mean_score(points: Float32, scores: Sequence[NDArray[Any]], cameras: Sequence[Camera]) -> tuple[Float32, Float32]:
    """Mean score of (N, 3) points over the views that have them in their image, and the share of views that do."""
    total, seen = np.zeros(len(points), np.float32), np.zeros(len(points), np.float32)
    for score, camera in zip(scores, cameras, strict=True):
        columns, lines, inside = pixels_of(points, camera)[:3]
        total[inside] += score[lines[inside], columns[inside]]
        seen += inside
    return (total / np.maximum(seen, 1)).astype(np.float32), seen / np.float32(max(len(cameras), 1))


def pixels_of(points: Float32, camera: Camera) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], Float32]:
    """Columns and lines of the pixels that (N, 3) points fall on, whether these are in the image, and depths in su."""
    x, y, z = (points @ row[:3] + row[3] for row in camera.cam_from_scene.astype(np.float32))
    ahead = z > 0
    z = np.where(ahead, z, 1)
    columns, lines = x / z * np.float32(camera.fx) + np.float32(camera.cx), y / z * np.float32(camera.fy)
    lines += np.float32(camera.cy)
    inside = ahead & (columns >= 0) & (columns < camera.width) & (lines >= 0) & (lines < camera.height)
    return np.where(inside, columns, 0).astype(np.int32), np.where(inside, lines, 0).astype(np.int32), inside, z


def _usual_share(shares: Float32, allowed: NDArray[np.bool_]) -> Float32:
    """The share that empty space around each cell has: an opening removes everything narrower than 0.09 R.

    Args:
        shares: (N,) of the N cells that are allowed (X, Y, Z).
    """
    from scipy import ndimage

    smooth = np.zeros(allowed.shape, np.float32)
    smooth[allowed] = shares
    weights = ndimage.gaussian_filter(allowed.astype(np.float32), 1.5)
    smooth = ndimage.gaussian_filter(smooth, 1.5) / np.maximum(weights, 1e-6)
    low = ndimage.minimum_filter(np.where(allowed, smooth, 1), 9)
    usual: Float32 = ndimage.maximum_filter(np.where(allowed, low, 0), 9)[allowed]
    return usual


def _map(points: Float32, affine: Float64) -> Float32:
    """(..., 3) points through a (3, 4) affine map."""
    return points @ affine[:, :3].T.astype(np.float32) + affine[:, 3].astype(np.float32)


def _contrast(shares: Float32, usual: Float32) -> Float32:
    """1 where all views see lint, 0 where as many see white as through the empty space around.

    Where nearly all backgrounds are white, lint hardly differs from them, and noise is not stretched.
    """
    return ((shares - usual) / np.maximum(1 - usual, LEAST_ROOM)).astype(np.float32)


def _level_axes(axis: Float64) -> Float64:
    """(3, 3) rows: two directions across a unit `axis`, and the axis."""
    x = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis])
