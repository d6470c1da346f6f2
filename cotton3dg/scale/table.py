# SPDX-License-Identifier: Apache-2.0
"""Finds the table under the plant: its plane, its rectangle and, by its known size, the scale of the scene.

All lengths below are relative to the radius R of the orbit, because nothing has a unit yet. The table lies inside the
orbit and below the cameras. The floor is larger, so the search begins with the highest of the large level planes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.measurements import Scale
from ..core.scene import Camera, Float64
from ..geometry.boxes import min_area_rectangle
from ..geometry.camera_orbit import Orbit, fit_orbit
from ..geometry.planes import CELL, TOLERANCE, level_planes
from .rectangle import CAUCHY, EDGES, PLANE_PRIOR, SEARCH, Rectangle, RimFit, fit_rim, smoothed

ASPECT_TOLERANCE: Final = 0.05
USUAL_ASPECT_ERROR: Final = 0.01
"""With a larger error of the aspect another fit is tried, with edges closer to the end of the points. The fit nearer to
the known shape is taken."""
MIN_FILL: Final = 0.8
LEAST_TRACKS: Final = 30
LEAST_PLANE_ERROR: Final = 2e-4
"""Least standard error of the plane, in widths of the table: 0.1 mm, about how flat a table is."""
MIN_SUPPORT: Final = 0.4
"""Least share of the places along an edge that show it. A third would show it by chance."""
CLEAR_SUPPORT: Final = 0.5
"""The same share for the two edges that alone give the scale when a third one is unclear."""
LEAST_ERROR: Final = 2e-3
"""Least relative error of the scale. The two sides do not show every error: a plane that lies a millimetre too high
makes both too short by the same share."""
LEAST_ERROR_OF_POINTS: Final = 1e-2
"""The same without photos, because points end before an edge and floaters lie beyond it."""
LEAST_ERROR_OF_ONE_SIDE: Final = 1e-2
"""The same with one unclear edge, because no second side checks the first."""


@dataclass(frozen=True)
class TableFit:
    """A table top with the evidence for it."""

    rectangle: Rectangle
    fill: float
    """Share of the rectangle that points of the plane cover."""
    inliers: int
    """Points on the plane inside the rectangle."""
    rim: RimFit | None
    """Edges in the photos; None when there are no photos or they do not show all edges."""

    @property
    def aspect(self) -> float:
        return self.rectangle.length / self.rectangle.width

    @property
    def unclear_edges(self) -> tuple[int, ...]:
        """Edges that the photos show at too few places, in the order of `Rectangle.sides`."""
        return tuple(edge for edge in EDGES if self.rim and self.rim.support[edge] < MIN_SUPPORT)

    @property
    def one_side_is_clear(self) -> bool:
        """Whether the side without the unclear edge can be relied upon."""
        assert self.rim
        clear = 2 - 2 * (self.unclear_edges[0] // 2)
        return min(self.rim.support[clear : clear + 2]) >= CLEAR_SUPPORT


@dataclass(frozen=True)
class NoTable:
    """The reason why no table was found, in a few words."""

    reason: str


def find_table(
    points: NDArray[Any],
    cameras: Sequence[Camera],
    images: Sequence[NDArray[np.uint8]] = (),
    image_cameras: Sequence[Camera] = (),
    *,
    tracks: NDArray[Any] | None = None,
    aspect: float = 2.0,
    seed: int = 0,
) -> TableFit | NoTable:
    """Find the rectangular table top that the cameras walk around.

    Args:
        points: (N, 3) su, of the surfaces in the scene.
        cameras: all of the orbit.
        images: photos, and `image_cameras` theirs; without photos the points alone give the rectangle.
        tracks: (M, 3) su, those of the points that structure from motion triangulated. Gaussians lie up to half a
            centimetre below the surface that they show, so the plane is taken from these where there are enough.
        aspect: length by width.
    Returns:
        The highest table with enough evidence, else the reason why the most likely one was refused.
    """
    points = np.asarray(points, np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    orbit = fit_orbit(cameras)
    planes = level_planes(points, orbit, seed)
    if not planes:
        return NoTable("no level plane lies below the cameras")
    refused = NoTable("")
    photos = smoothed(images)
    for plane in planes:
        first = find_first_rectangle(points, plane, orbit)
        if first is None:
            continue
        first, plane_error = _level(first, tracks, orbit.radius) if tracks is not None else (first, PLANE_PRIOR)
        # The strongest line may be a seam or a shadow along an edge of wood before wood. Then the shape is nearly
        # right, and the edges are searched again close to where the points end. On any other plane a mere texture would
        # pass that search.
        guesses = [first, first, *_complete(first, aspect)] if photos else [first]
        fits: list[TableFit] = []
        off = np.inf  # the last fit's shape from the known one
        for number, guess in enumerate(guesses):
            if (number == 1 and not USUAL_ASPECT_ERROR < off < 2 * SEARCH) or (number > 1 and fits):
                continue
            rim = fit_rim(guess, image_cameras, photos, plane_error, narrow=number == 1) if photos else None
            if photos and rim is None:
                refused = refused if refused.reason else NoTable("the photos do not show all edges of the plane")
                continue
            rectangle = turn_along_long_side(rim.rectangle if rim else guess, cameras)
            fill, inliers = _measure_coverage(rectangle, points, orbit.radius)
            fit = TableFit(rectangle, fill, inliers, rim)
            off = abs(fit.aspect / aspect - 1)
            # A guess made from the known shape does not confirm it, nor does a choice of lines with that shape: there
            # every edge must be seen.
            doubt = _doubt(fit, aspect, most_unclear=0 if number else 1)
            if not doubt:
                fits.append(fit)
            refused = refused if refused.reason else NoTable(doubt)
        if fits:
            return min(fits, key=lambda fit: abs(fit.aspect / aspect - 1))
    return refused if refused.reason else NoTable("no plane is bounded like a table")


def scale_from_table(fit: TableFit, length_cm: float, width_cm: float) -> Scale:
    """The scale at which a table has its known size, by least squares over both sides.

    Edges are found equally well on all sides, so the longer side is more precise, and the short side would dominate a
    plain mean of the two ratios. (Cotton3DGaussians uses the short side alone, see `sections`.) The error is half their
    disagreement, as for a mean of two, and at least `LEAST_ERROR` (`LEAST_ERROR_OF_POINTS` without photos), because the
    two may agree by chance. A side that ends in an unclear edge, such as that of a wooden table before a wooden floor,
    is left out.
    """
    measured, known = np.array([fit.rectangle.length, fit.rectangle.width]), np.array([length_cm, width_cm])
    least = LEAST_ERROR if fit.rim else LEAST_ERROR_OF_POINTS
    if fit.unclear_edges:
        clear = 1 - fit.unclear_edges[0] // 2
        measured, known, least = measured[[clear]], known[[clear]], LEAST_ERROR_OF_ONE_SIDE
    cm_per_su = float(measured @ known / (measured @ measured))
    ratios = known / measured
    error = float((ratios.max() - ratios.min()) / 2 / cm_per_su)
    up = fit.rectangle.axes[2]
    plane = np.append(up, -up @ fit.rectangle.origin)
    return Scale(cm_per_su, max(error, least), "table", up, plane, fit.rectangle.corners)


def outlines_table(points: NDArray[Any], orbit: Orbit, aspect: float) -> bool:
    """Whether the points alone, without the photos, show a level rectangle of about the known shape."""
    points = np.asarray(points, np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    found = [find_first_rectangle(points, plane, orbit) for plane in level_planes(points, orbit)]
    return any(abs(first.length / first.width / aspect - 1) < SEARCH for first in found if first is not None)


def find_first_rectangle(points: Float64, plane: Float64, orbit: Orbit) -> Rectangle | None:
    """The rectangle around the largest connected part of a plane; None for a speck."""
    import cv2
    from scipy.spatial import cKDTree

    axes = _level_axes(plane[:3])
    origin = orbit.centre - (plane[:3] @ orbit.centre + plane[3]) * plane[:3]
    places = (points - origin) @ axes.T
    radius = orbit.radius
    places = places[(np.abs(places[:, 2]) < TOLERANCE * radius) & (np.linalg.norm(places[:, :2], axis=1) < radius)]
    half = int(np.ceil(1 / CELL))
    cells = np.floor(places[:, :2] / (CELL * radius)).astype(int) + half
    covered = np.zeros((2 * half, 2 * half), np.uint8)
    covered[cells[:, 1], cells[:, 0]] = 1
    # Weak texture leaves holes, the wider the sparser the points are; floaters beyond the rim are single cells.
    spots = np.argwhere(covered)
    spacing = np.median(cKDTree(spots).query(spots, k=2)[0][:, 1]) if len(spots) > 1 else 1.0
    size = 2 * int(np.clip(3 * spacing, 3, 12)) + 1
    closed = cv2.morphologyEx(covered, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))
    opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    parts = cv2.connectedComponents(opened)[1]
    sizes = np.bincount(parts.ravel())
    if len(sizes) < 2:
        return None
    part = parts == 1 + int(np.argmax(sizes[1:]))
    y, x = np.nonzero(part)
    corners = np.concatenate([np.stack([x + dx, y + dy], 1) for dx in (0, 1) for dy in (0, 1)])
    box = min_area_rectangle((corners - half) * CELL * radius)
    if box.sides[1] < 0.1 * radius:
        return None
    inside = (np.stack([x, y], 1) + 0.5 - half) * CELL * radius @ box.axes.T
    limits = np.stack([_find_half_covered(inside[:, k], CELL * radius) for k in (0, 1)])
    # Cells are coarse: the sides go to the outermost points within them.
    along = places[part[cells[:, 1], cells[:, 0]], :2] @ box.axes.T
    along = along[((along >= limits[:, 0]) & (along <= limits[:, 1])).all(axis=1)]
    sides = np.stack([along.min(axis=0), along.max(axis=0)], axis=1)
    return Rectangle(np.vstack([box.axes @ axes[:2], axes[2]]), origin, sides.ravel())


def _level(first: Rectangle, tracks: NDArray[Any], radius: float) -> tuple[Rectangle, float]:
    """`first` on the plane through the tracks inside it, and the plane's standard error in widths of the table.

    Least squares with Cauchy weights. Neighbouring points err alike, so an eighth of them counts.
    """
    places = first.places(np.asarray(tracks, np.float64))
    rim = 0.03 * first.width
    x0, x1, y0, y1 = first.sides + rim * np.array([1, -1, 1, -1])
    near = (places[:, 0] > x0) & (places[:, 0] < x1) & (places[:, 1] > y0) & (places[:, 1] < y1)
    near &= np.abs(places[:, 2]) < 2 * TOLERANCE * radius
    if near.sum() < LEAST_TRACKS:
        return first, PLANE_PRIOR
    flat = np.column_stack([places[near, :2] - first.middle, np.ones(near.sum())])
    heights = places[near, 2]
    slopes = np.array([0.0, 0.0, float(np.median(heights))])
    for _ in range(10):
        away = heights - flat @ slopes
        sigma = max(1.4826 * float(np.median(np.abs(away))), 1e-6 * first.width)
        root = 1 / np.sqrt(1 + (away / (CAUCHY * sigma)) ** 2)
        slopes = np.linalg.lstsq(root[:, None] * flat, root * heights, rcond=None)[0]
    error = float(np.clip(sigma / np.sqrt(near.sum() / 8) / first.width, LEAST_PLANE_ERROR, PLANE_PRIOR))
    centred = Rectangle(first.axes, first.points(first.middle), first.sides - np.repeat(first.middle, 2))
    # A turn about x by a small angle raises what lies at +y, one about y lowers what lies at +x.
    return centred.moved(np.array([slopes[1], -slopes[0], 0, slopes[2], 0, 0, 0, 0])), error


def _complete(first: Rectangle, aspect: float) -> list[Rectangle]:
    """Possible tables of known shape if the points cover only a part: the short side is extended at either end."""
    length, width = first.length, first.width
    if length > aspect * width * (1 - ASPECT_TOLERANCE):
        # The points cover the whole length, so a part of the width is missing.
        side, lacking = 2, length / aspect - width
    else:
        side, lacking = 0, aspect * width - length
    guesses = []
    for move in ((-1.0, 0.0), (0.0, 1.0), (-0.5, 0.5)):
        sides = first.sides.copy()
        sides[side : side + 2] += lacking * np.array(move)
        guesses.append(Rectangle(first.axes, first.origin, sides))
    return guesses


def _find_half_covered(values: Float64, step: float) -> Float64:
    """The ends (2,) between which a profile of cells is at least half as high as in its middle."""
    low = values.min() - step / 2
    counts = np.bincount(((values - low) / step).astype(int))
    enough = np.flatnonzero(counts >= 0.5 * np.median(counts))
    return np.array([low + enough[0] * step, low + (enough[-1] + 1) * step])


def _measure_coverage(rectangle: Rectangle, points: Float64, radius: float) -> tuple[float, int]:
    """Share of a rectangle that has a point of the plane within two cells, and how many points those are."""
    import cv2

    places = rectangle.places(points)
    x, y = places[:, 0] - rectangle.sides[0], places[:, 1] - rectangle.sides[2]
    on = (np.abs(places[:, 2]) < TOLERANCE * radius) & (x >= 0) & (x < rectangle.length)
    on &= (y >= 0) & (y < rectangle.width)
    step = CELL * radius
    covered = np.zeros((int(rectangle.width / step) + 1, int(rectangle.length / step) + 1), np.uint8)
    covered[(y[on] / step).astype(int), (x[on] / step).astype(int)] = 1
    return float(cv2.dilate(covered, np.ones((5, 5), np.uint8)).mean()), int(on.sum())


def _doubt(fit: TableFit, aspect: float, most_unclear: int) -> str:
    """Why a fit is not a table of that shape; '' if it is one. At most `most_unclear` edges may be unclear."""
    if abs(fit.aspect / aspect - 1) > ASPECT_TOLERANCE:
        return f"the plane's sides are as {fit.aspect:.2f} to 1 where the table's are as {aspect:.2f} to 1"
    if fit.fill < MIN_FILL:
        return f"only {fit.fill:.0%} of the table top was reconstructed"
    if fit.rim and (len(fit.unclear_edges) > most_unclear or (fit.unclear_edges and not fit.one_side_is_clear)):
        return f"an edge of the table shows at only {min(fit.rim.support):.0%} of its length"
    return ""


def outline_table(image: NDArray[np.uint8], camera: Camera, rectangle: Rectangle) -> NDArray[np.uint8]:
    """A copy of a (H, W, 3) photo with the outline of a table drawn on it."""
    import cv2

    canvas = image.copy()
    ends = np.linspace(0, 1, 200)
    for edge in range(4):
        pixels, depths = camera.project(rectangle.points(rectangle.edge_places(edge, ends)))
        # Edges may run behind the camera, so they are drawn piece by piece.
        pixels = np.clip(np.nan_to_num(pixels, nan=-1e5), -1e5, 1e5)
        for a, b, seen in zip(pixels[:-1], pixels[1:], (depths[:-1] > 0) & (depths[1:] > 0), strict=True):
            if seen:
                # Sixteenths of a pixel, counted from the centre of the first.
                start, stop = (tuple(round(16 * (float(value) - 0.5)) for value in end) for end in (a, b))
                cv2.line(canvas, start, stop, (255, 0, 255), 1, cv2.LINE_AA, shift=4)
    return canvas


def turn_along_long_side(rectangle: Rectangle, cameras: Sequence[Camera]) -> Rectangle:
    """The same rectangle with x along its long side, towards where the first camera stands, and its origin amid it."""
    axes = rectangle.axes
    middle = rectangle.points(rectangle.middle)
    half = np.array([rectangle.length, rectangle.width]) / 2
    if half[0] < half[1]:
        axes, half = np.stack([axes[1], -axes[0], axes[2]]), half[::-1]
    if (cameras[0].centre - middle) @ axes[0] < 0:
        axes = axes * np.array([[-1.0], [-1.0], [1.0]])
    return Rectangle(axes, middle, np.array([-half[0], half[0], -half[1], half[1]]))


def _level_axes(up: Float64) -> Float64:
    """(3, 3) rows: some x and y in a plane and its normal."""
    x = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])
