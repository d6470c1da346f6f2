# SPDX-License-Identifier: Apache-2.0
"""Measures the rim of a flat rectangular table in the photos.

Only silhouette views count for an edge: those whose camera stands on the inner side of it. From there the edge of the
top hides the side face, so the top edge, and never the bottom one, stands against the background.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float64

EDGES: Final = (0, 1, 2, 3)
PLACES: Final = 64
"""Number of places along an edge at which it is searched."""
SEARCH: Final = 0.12
"""Largest distance of an edge from its first estimate, in widths of the table."""
TURN: Final = np.radians(3.0)
"""Largest angle between the first rectangle and the table, rad."""
PLANE_PRIOR: Final = 0.004
"""Standard error of the plane, in widths of the table, if nothing better is known; the edges may move it so far."""
CAUCHY: Final = 2.385
"""Distance from an edge, in robust standard deviations, at which a maximum's pull begins to weaken. With normal errors
least squares lose 5 % of their efficiency by it (Holland and Welsch 1977)."""
SHARPEST_PX: Final = 0.2
"""Standard deviation of the sharpest edges."""
ROUNDS: Final = ((6.0, 1e-3), (3.0, 1e-4))
"""Distance from an edge within which its maxima are searched, px, and the motion of the corners, in widths of the
table, below which a round ends."""
MOST_ROUNDS: Final = 8
ALONG: Final = 0.3
"""Quantile along an edge that stands for its contrast. Paper beside an edge has more contrast, but is shorter."""
STRONG: Final = 0.75
"""Contrast of an edge relative to the strongest line beside it ..."""
WEAK: Final = 0.3
"""... and the same where a stronger line lies beside it."""
MIN_VIEWS: Final = 3


@dataclass(frozen=True)
class Rectangle:
    """A rectangle in space: a table top."""

    axes: Float64
    """(3, 3) rows: unit long side x, short side y, up."""
    origin: Float64
    """(3,) a point of the plane, su."""
    sides: Float64
    """(4,) places of the edges relative to the origin, first the x of two, then the y of two: x_min, x_max, y_min,
    y_max; su."""

    @property
    def length(self) -> float:
        return float(self.sides[1] - self.sides[0])

    @property
    def width(self) -> float:
        return float(self.sides[3] - self.sides[2])

    @property
    def corners(self) -> Float64:
        """(4, 3) su, in order around the table; edge 0-1 is a long side."""
        x0, x1, y0, y1 = self.sides
        return self.points(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))

    @property
    def middle(self) -> Float64:
        """(2,) place of the middle, su from the origin."""
        return np.array([self.sides[:2].mean(), self.sides[2:].mean()])

    def points(self, xy: NDArray[Any]) -> Float64:
        """(..., 3) scene points of (..., 2) places on the table, su from the origin."""
        return self.origin + np.asarray(xy, np.float64) @ self.axes[:2]

    def places(self, points: NDArray[Any]) -> Float64:
        """(..., 3) places of (..., 3) scene points: x, y and height above the table, su from the origin."""
        return (np.asarray(points, np.float64) - self.origin) @ self.axes.T

    def moved(self, change: Float64) -> Rectangle:
        """The rectangle after a small rotation about x, y, up (3, radian), a lift (1) and moves of its sides (4)."""
        from scipy.spatial.transform import Rotation

        turned = Rotation.from_rotvec(change[:3]).as_matrix().T @ self.axes
        return Rectangle(turned, self.origin + change[3] * self.axes[2], self.sides + change[4:])

    def edge_places(self, edge: int, along: NDArray[Any], outwards: NDArray[Any] | float = 0.0) -> Float64:
        """(..., 2) places on an edge: `along` in 0..1 from end to end, moved `outwards` from it, su."""
        low, high = self.sides[[2, 3] if edge < 2 else [0, 1]]
        other = low + np.asarray(along) * (high - low)
        here = self.sides[edge] + (1 if edge % 2 else -1) * np.asarray(outwards)
        here, other = np.broadcast_arrays(here, other)
        return np.stack([here, other] if edge < 2 else [other, here], axis=-1)

    def hides_its_side(self, edge: int, camera: Camera) -> bool:
        """Whether the camera stands above the table's plane and on the inner side of the edge."""
        x, y, height = self.places(camera.centre)
        return bool(height > 0 and ((x, y)[edge // 2] - self.sides[edge]) * (1 if edge % 2 else -1) < 0)


@dataclass(frozen=True)
class RimFit:
    """A rectangle after its edges were measured in the photos."""

    rectangle: Rectangle
    residual_px: tuple[float, ...]
    """Median distance of each edge from what the photos show, in the order of `Rectangle.sides`."""
    support: tuple[float, ...]
    """Share of the searched places, over all views of each edge, at which the photos show it within 2 px. In a narrow
    fit it is within 1 px. That is weaker evidence, because a mere texture has maxima so near, too."""
    views: tuple[int, ...]
    """Number of photos that show each edge as a silhouette."""


def smoothed(images: Sequence[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
    """(H, W, 3) photos without the finest noise, which looks like edges."""
    import cv2

    return [cv2.GaussianBlur(image, (0, 0), 0.8) for image in images]


def fit_rim(
    first: Rectangle,
    cameras: Sequence[Camera],
    images: Sequence[NDArray[np.uint8]],
    plane_error: float = PLANE_PRIOR,
    *,
    narrow: bool = False,
) -> RimFit | None:
    """Measure the edges of a table in photos.

    Each edge is first searched within `SEARCH` of its place, where the contrast across it, added up over all views, is
    strong: only lines on the plane stay in place from view to view. Then edges and plane are fitted together to the
    maxima of contrast in each view (least squares with Cauchy loss), the plane within its error.

    Args:
        first: the rectangle as points give it.
        images: (H, W, 3) of the cameras, as `smoothed` makes them.
        plane_error: standard error of the plane of `first`, in widths of the table.
        narrow: for edges beside a stronger line; search only a quarter as far from `first`, and accept weaker edges.
    Returns:
        None when an edge shows in fewer than `MIN_VIEWS` views, at too few places, or nowhere near.
    """
    views = list(zip(cameras, images, strict=True))
    search, rounds, least = (SEARCH / 4, ROUNDS[1:], WEAK) if narrow else (SEARCH, ROUNDS, STRONG)
    rectangle = _fit_roughly(first, views, search * first.width, TURN, least)
    rectangle = rectangle and _fit_roughly(rectangle, views, search / 4 * first.width, TURN / 4, least)
    if rectangle is None:
        return None
    anchor = rectangle
    for reach_px, settled in rounds:
        for _ in range(MOST_ROUNDS):
            before = rectangle.corners
            seen = [_find_maxima(rectangle, edge, views, reach_px, narrow) for edge in EDGES]
            if min(len(found.view) for found in seen) < PLACES:
                return None
            rectangle = _adjust(anchor, rectangle, cameras, seen, plane_error)
            if np.abs(rectangle.corners - before).max() < settled * first.width:
                break
        if np.abs(rectangle.corners - anchor.corners).max() > search * first.width:
            return None
    offsets = [np.abs(_distances(rectangle, edge, cameras, found)) for edge, found in zip(EDGES, seen, strict=True)]
    # The search is wide: among the maxima of a mere texture a third would lie that close.
    far_px = rounds[0][0]
    wide = [_find_maxima(rectangle, edge, views, far_px, narrow) for edge in EDGES]
    away = [np.abs(_distances(rectangle, edge, cameras, found)) for edge, found in zip(EDGES, wide, strict=True)]
    return RimFit(
        rectangle,
        tuple(float(np.median(d)) for d in offsets),
        tuple(float((d < far_px / 3).sum() / found.looked) for d, found in zip(away, wide, strict=True)),
        tuple(len(np.unique(found.view)) for found in seen),
    )


@dataclass(frozen=True)
class _Maxima:
    """The places where the photos show an edge."""

    view: NDArray[np.int64]
    """(n,) number of the camera."""
    along: Float64
    """(n,) place along the edge, 0..1."""
    pixels: Float64
    """(n, 2) px."""
    normals: Float64
    """(n, 2) unit normals of the edge in the photo."""
    looked: int
    """Number of searched places, with a maximum or without."""


_View = tuple[Camera, NDArray[np.uint8]]


def _fit_roughly(first: Rectangle, views: list[_View], reach: float, most: float, least: float) -> Rectangle | None:
    """`first` turned as a whole, with each edge moved to the line of strong contrast, summed over views.

    Args:
        least: contrast of an edge relative to the strongest line beside it.
    """
    steps = np.linspace(-reach, reach, 161)
    turns = np.linspace(-most, most, 25)
    profiles = []
    for edge in EDGES:
        contrast = _contrast_map(first, edge, views, steps)
        if contrast is None:
            return None
        low, high = first.sides[[2, 3] if edge < 2 else [0, 1]]
        ways = (_along() - 0.5) * (high - low)
        # Turning counter-clockwise moves an edge outwards at one end and inwards at the other.
        sign = -1 if edge in (1, 2) else 1
        sheared = _shifted(contrast, sign * turns[:, None] * ways, float(steps[1] - steps[0]))
        profiles.append(np.quantile(sheared, ALONG, axis=1))
    best = int(np.argmax(sum(profile.max(axis=1) for profile in profiles)))
    outwards = [steps[_find_outermost(profile[best], least)] for profile in profiles]
    centred = Rectangle(first.axes, first.points(first.middle), first.sides - np.repeat(first.middle, 2))
    return centred.moved(np.array([0, 0, turns[best], 0, -outwards[0], outwards[1], -outwards[2], outwards[3]]))


def _shifted(rows: Float64, ways: Float64, step: float) -> Float64:
    """(T, P, S) rows (P, S) of samples `step` apart, shifted by `ways` (T, P); beyond a row's end its last sample."""
    last = rows.shape[1] - 1
    places = np.clip(np.arange(last + 1) + ways[..., None] / step, 0, last)
    before = np.minimum(places.astype(np.int64), last - 1)
    share = places - before
    row = np.arange(len(rows))[:, None]
    shifted: Float64 = rows[row, before] * (1 - share) + rows[row, before + 1] * share
    return shifted


def _contrast_map(rectangle: Rectangle, edge: int, views: list[_View], steps: Float64) -> Float64 | None:
    """(PLACES, len(steps)) mean contrast over the views along lines beside an edge; None when too few views show it."""
    total, count = np.zeros((2, PLACES, len(steps)))
    n_views = 0
    points = rectangle.points(rectangle.edge_places(edge, _along()[:, None], steps[None]))
    ahead = rectangle.axes[1 if edge < 2 else 0] * 1e-3 * rectangle.width
    for camera, image in views:
        if not rectangle.hides_its_side(edge, camera):
            continue
        pixels, normals, inside = _on_image(camera, points, ahead)
        if inside.mean() < 0.1:
            continue
        n_views += 1
        contrast = _difference(image, pixels, normals)
        # Strong background edges of one photo would dominate the rest.
        total += np.where(inside, np.minimum(contrast, np.percentile(contrast[inside], 95)), 0)
        count += inside
    return total / np.maximum(count, 1) if n_views >= MIN_VIEWS else None


def _find_outermost(profile: Float64, least: float) -> int:
    """Index of the outermost strong maximum. Lines farther inside (seams, tape) are not the rim."""
    base = np.median(profile)
    strong = profile - base >= least * (profile.max() - base)
    peaks = strong & (profile >= np.roll(profile, 1)) & (profile >= np.roll(profile, -1))
    return int(np.flatnonzero(peaks)[-1]) if peaks.any() else int(profile.argmax())


def _find_maxima(
    rectangle: Rectangle, edge: int, views: list[_View], reach_px: float, nearest: bool = False
) -> _Maxima:
    """The strongest contrast within `reach_px` of the edge, or the nearest one that is not much weaker, at each place
    of each view that shows the edge as a silhouette.
    """
    points = rectangle.points(rectangle.edge_places(edge, _along()))
    ahead = rectangle.axes[1 if edge < 2 else 0] * 1e-3 * rectangle.width
    steps = np.arange(-reach_px - 0.5, reach_px + 0.51, 0.5)
    parts, looked = [], 0
    for number, (camera, image) in enumerate(views):
        if not rectangle.hides_its_side(edge, camera):
            continue
        pixels, normals, inside = _on_image(camera, points, ahead)
        pixels, normals = pixels[inside], normals[inside]
        looked += len(pixels)
        if not len(pixels):
            continue
        profile = _difference(image, pixels[:, None] + steps[None, :, None] * normals[:, None], normals[:, None])
        within = profile[:, 1:-1]
        peak = 1 + within.argmax(axis=1)
        if nearest:
            tops = (within >= profile[:, :-2]) & (within >= profile[:, 2:])
            tops &= within >= WEAK * within.max(axis=1, keepdims=True)
            peak = 1 + np.where(tops, np.abs(steps[1:-1]), np.inf).argmin(axis=1)
        before, here, after = (np.take_along_axis(profile, (peak + k)[:, None], 1)[:, 0] for k in (-1, 0, 1))
        bend = before - 2 * here + after
        fine = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1), 0)
        offset = steps[peak] + np.clip(fine, -0.5, 0.5) * 0.5
        # A maximum at the end of the profile belongs to something farther out.
        clear = (np.abs(offset) < reach_px) & (here >= 3.0)
        part = (np.full(len(pixels), number), _along()[inside], pixels + offset[:, None] * normals, normals)
        parts.append([column[clear] for column in part])
    if not parts:
        return _Maxima(np.zeros(0, int), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2)), 0)
    view, along, pixels, normals = (np.concatenate(column) for column in zip(*parts, strict=True))
    return _Maxima(view, along, pixels, normals, looked)


def _adjust(
    anchor: Rectangle, start: Rectangle, cameras: Sequence[Camera], seen: list[_Maxima], plane_error: float
) -> Rectangle:
    """`start` moved so that its edges meet the maxima in the photos; tilt and height stay near those of `anchor`.

    Gauss-Newton with the weights of the Cauchy loss; two steps, because the maxima are searched anew afterwards.
    """
    unit = np.array([1, 1, 1, *[start.width] * 5])
    rectangle = start
    for _ in range(2):
        here = _residuals(rectangle, anchor, cameras, seen)
        sigma_px = max(1.4826 * float(np.median(np.abs(here[:-3]))), SHARPEST_PX)
        # Neighbouring places of a photo err alike, so they count eight times too often. The prior gets the same factor.
        prior_weight = 8 * (sigma_px / plane_error) ** 2
        nudges = 1e-6 * np.eye(8)
        slopes = [(_residuals(rectangle.moved(n * unit), anchor, cameras, seen) - here) / 1e-6 for n in nudges]
        weights = 1 / (1 + (here / (CAUCHY * sigma_px)) ** 2)
        weights[-3:] = prior_weight
        jacobian = np.stack(slopes, axis=1)
        normal = jacobian.T @ (weights[:, None] * jacobian)
        # An edge without a view is not determined; the ridge keeps it where it is.
        normal += 1e-9 * np.trace(normal) * np.eye(8)
        rectangle = rectangle.moved(-np.linalg.solve(normal, jacobian.T @ (weights * here)) * unit)
    return rectangle


def _residuals(rectangle: Rectangle, anchor: Rectangle, cameras: Sequence[Camera], seen: list[_Maxima]) -> Float64:
    """Distances of all maxima from their edges, px, then tilt (2) and lift (1) against `anchor`, in widths."""
    edges = [_distances(rectangle, edge, cameras, found) for edge, found in zip(EDGES, seen, strict=True)]
    lift = (rectangle.origin - anchor.origin) @ anchor.axes[2] / anchor.width
    return np.concatenate([*edges, anchor.axes[:2] @ rectangle.axes[2], [lift]])


def _distances(rectangle: Rectangle, edge: int, cameras: Sequence[Camera], found: _Maxima) -> Float64:
    """(n,) px between the edge and each maximum, along the edge's normal in the photo."""
    points = rectangle.points(rectangle.edge_places(edge, found.along))
    # All at once, each by its own camera: this is the innermost loop of the fit.
    poses = np.stack([camera.cam_from_scene for camera in cameras])[found.view]
    lenses = np.array([(camera.fx, camera.fy, camera.cx, camera.cy) for camera in cameras])[found.view]
    in_camera = np.einsum("nij,nj->ni", poses[:, :, :3], points) + poses[:, :, 3]
    pixels = in_camera[:, :2] / in_camera[:, 2:] * lenses[:, :2] + lenses[:, 2:]
    distances: Float64 = np.einsum("ij,ij->i", pixels - found.pixels, found.normals)
    return distances


def _on_image(camera: Camera, points: Float64, ahead: Float64) -> tuple[Float64, Float64, NDArray[np.bool_]]:
    """Pixels and unit normals (..., 2) of lines through `points` in direction `ahead`, and which lie on the image."""
    shape = points.shape[:-1]
    pixels, _ = camera.project(points.reshape(-1, 3))
    further, _ = camera.project((points + ahead).reshape(-1, 3))
    tangents = further - pixels
    lengths = np.linalg.norm(tangents, axis=1)
    margin = 10
    inside = (pixels > margin).all(axis=1) & (pixels < (camera.width - margin, camera.height - margin)).all(axis=1)
    inside &= lengths > 0
    normals = np.where(
        inside[:, None], np.stack([-tangents[:, 1], tangents[:, 0]], 1) / np.where(inside, lengths, 1)[:, None], 0
    )
    pixels = np.where(inside[:, None], pixels, margin)
    return pixels.reshape(*shape, 2), normals.reshape(*shape, 2), inside.reshape(shape)


def _difference(image: NDArray[np.uint8], pixels: Float64, normals: Float64) -> Float64:
    """(...) colour distance between the two sides of lines, 1 px before and behind each of the (..., 2) pixels."""
    import cv2

    sides = []
    for sign in (-1, 1):
        # OpenCV counts from the centre of the first pixel.
        at = (pixels + sign * normals - 0.5).astype(np.float32).reshape(-1, 2)
        rows = np.array_split(at, max(1, len(at) // 30_000))
        values = [cv2.remap(image, part[None, :, 0], part[None, :, 1], cv2.INTER_LINEAR)[0] for part in rows]
        sides.append(np.concatenate(values).astype(np.float64).reshape(len(at), -1))
    difference: Float64 = np.linalg.norm(sides[1] - sides[0], axis=1).reshape(pixels.shape[:-1])
    return difference


def _along() -> Float64:
    """Places along an edge, 0..1, without the corners, where two edges meet."""
    return np.linspace(0.03, 0.97, PLACES)
