# SPDX-License-Identifier: Apache-2.0
"""Finds printed markers of known size in photos and in space: ArUco and AprilTag squares, and ChArUco boards.

A square's corners are refined by lines fitted to its sides, in linear light, and then by the edges between its cells
(`marker_cells`), because ink, lens and tone curve make dark squares larger or smaller. A board's corners lie between
two dark and two bright squares, so this does not move them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float64
from ..errors import BadUsage
from ..geometry.printed_markers import find_squares, marker_dictionary
from ..geometry.triangulation import Sighting, triangulate
from .marker_cells import fit_to_cells
from .references import LEAST_ERROR, NoReference, Reference, distance_ratios

INNER: Final = 0.75
"""Side of a ChArUco board's markers in squares of the board."""
LEAST_VIEWS: Final = 6
MAX_ERROR: Final = 0.02
"""Largest relative error. Markers that scatter more are not used."""
PLACES: Final = 24
"""Number of places along a side of a square at which its edge is searched."""

Corner = tuple[str, int, int]
"""Kind (`marker` or `board`), id of the marker, number of the corner; for a board, 0 and the number of its corner."""


@dataclass(frozen=True)
class MarkerKind:
    """A kind of printed markers."""

    dictionary: str
    """As OpenCV names it without `DICT_`, e.g. `4x4_50` or `apriltag_36h11`."""
    side_cm: float
    """Side of a marker's black square, or of one of a board's squares."""
    board: tuple[int, int] | None = None
    """Columns and rows of squares of a ChArUco board; None = loose markers."""

    def corner_cm(self, corner: Corner) -> Float64:
        """(2,) place of a corner on its sheet, from the top left one of its marker or board."""
        if corner[0] == "board" and self.board:
            return self.side_cm * np.array([corner[2] % (self.board[0] - 1), corner[2] // (self.board[0] - 1)], float)
        return self.side_cm * np.array([(0, 0), (1, 0), (1, 1), (0, 1)][corner[2]], float)


@dataclass(frozen=True)
class MarkerFit:
    """The corners on which several views agree, and the scale that they give."""

    reference: Reference
    sightings: dict[Corner, Sighting]


def board_squares(text: str) -> tuple[int, int] | None:
    """Columns and rows of a ChArUco board, e.g. from `4x5`; None from ''.

    Raises:
        BadUsage: the text does not describe a board.
    """
    if not text:
        return None
    columns, by, rows = text.lower().partition("x")
    if not (by and columns.isdecimal() and rows.isdecimal() and min(int(columns), int(rows)) > 1):
        raise BadUsage(f"board {text!r} cannot be used; write COLUMNSxROWS, e.g. 4x5")
    return int(columns), int(rows)


def charuco_board(kind: MarkerKind) -> Any:
    """OpenCV's board, in squares."""
    import cv2

    return cv2.aruco.CharucoBoard(kind.board, 1.0, INNER, marker_dictionary(kind.dictionary))


def find_markers(image: NDArray[np.uint8], kind: MarkerKind) -> dict[Corner, Float64]:
    """Corners in a (H, W, 3) photo, (2,) px each, without ids that the photo shows twice."""
    import cv2

    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if kind.board:
        corners, ids, _, _ = cv2.aruco.CharucoDetector(charuco_board(kind)).detectBoard(grey)
        if ids is None:
            return {}
        # OpenCV counts from the centre of the first pixel.
        found = zip(ids.ravel().tolist(), corners.reshape(-1, 2).astype(np.float64) + 0.5, strict=True)
        return {("board", 0, number): place for number, place in found}
    squares = find_squares(grey, kind.dictionary)
    if not squares:
        return {}
    light = (grey.astype(np.float32) / 255) ** np.float32(2.2)
    places: dict[Corner, Float64] = {}
    for number, square in squares.items():
        corners = fit_to_cells(light, refine_quad(light, square), marker_cells(kind.dictionary, number))
        places |= {("marker", number, k): corner for k, corner in enumerate(corners)}
    return places


@cache
def marker_cells(dictionary: str, number: int) -> NDArray[np.bool_]:
    """(n, n) which cells of a marker are dark, its border included."""
    import cv2

    words = marker_dictionary(dictionary)
    cells = words.markerSize + 2
    dark: NDArray[np.bool_] = np.asarray(cv2.aruco.generateImageMarker(words, number, cells)) == 0
    return dark


def refine_quad(light: NDArray[np.float32], quad: Float64) -> Float64:
    """(4, 2) corners where lines through the sides of a dark square on bright paper meet; `quad` if they are unsure.

    Args:
        light: (H, W) linear light.
        quad: (4, 2) px, corners in order around the square.
    """
    import cv2

    sides = np.roll(quad, -1, axis=0) - quad
    lengths = np.linalg.norm(sides, axis=1)
    # A dark border is a sixth to a ninth of a square wide: the profile must not reach the bits behind it.
    across = np.roll(lengths, 1)
    along = np.linspace(0.08, 0.92, PLACES)
    lines = []
    for corner, side, length, width in zip(quad, sides, lengths, across, strict=True):
        normal = np.array([side[1], -side[0]]) / max(length, 1e-9)
        reach = float(np.clip(width / 10, 1.0, 4.0))
        steps = np.arange(-reach - 0.5, reach + 0.51, 0.25)
        at = (corner + along[:, None, None] * side + steps[None, :, None] * normal - 0.5).astype(np.float32)
        profile = cv2.remap(light, at[..., 0], at[..., 1], cv2.INTER_LINEAR).astype(np.float64)
        slope = np.abs(profile[:, 4:] - profile[:, :-4])
        peak = 1 + slope[:, 1:-1].argmax(axis=1)
        before, here, after = (np.take_along_axis(slope, (peak + k)[:, None], 1)[:, 0] for k in (-1, 0, 1))
        bend = before - 2 * here + after
        fine = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1), 0.0)
        offset = steps[2 + peak] + np.clip(fine, -0.5, 0.5) * 0.25
        inner = (peak > 1) & (peak < slope.shape[1] - 2) & (here > 0.3 * np.median(here))
        if inner.sum() < PLACES / 2:
            return quad
        points = corner + along[inner, None] * side + offset[inner, None] * normal
        lines.append(_fit_line(points))
    corners = []
    for k in range(4):
        (a, da), (b, db) = lines[k - 1], lines[k]
        matrix = np.stack([da, -db], axis=1)
        if abs(np.linalg.det(matrix)) < 1e-3:
            return quad
        corners.append(a + da * np.linalg.solve(matrix, b - a)[0])
    moved = np.array(corners)
    return moved if np.linalg.norm(moved - quad, axis=1).max() < 3.0 else quad


def _fit_line(points: Float64) -> tuple[Float64, Float64]:
    """A point of the line through (N, 2) points, and its direction; points far off do not count."""
    kept = np.ones(len(points), bool)
    for _ in range(3):
        middle = points[kept].mean(axis=0)
        direction = np.linalg.svd(points[kept] - middle)[2][0]
        away = np.abs((points - middle) @ np.array([-direction[1], direction[0]]))
        kept = away <= max(3 * 1.4826 * float(np.median(away)), 0.05)
    return middle, direction


def scale_from_markers(
    cameras: Sequence[Camera], found: Sequence[Mapping[Corner, Float64]], kind: MarkerKind
) -> MarkerFit | NoReference:
    """The scale at which markers have their known size.

    Args:
        found: what `find_markers` found in the photo of each camera.
    """
    if not any(found):
        return NoReference("no photo shows a marker")
    name = (lambda corner: "board") if kind.board else (lambda corner: corner[1])
    return fit_bodies(cameras, found, kind.corner_cm, name, "aruco")


def fit_bodies(
    cameras: Sequence[Camera],
    found: Sequence[Mapping[Corner, Float64]],
    place_cm: Callable[[Corner], Float64],
    body_of: Callable[[Corner], Any],
    source: str,
) -> MarkerFit | NoReference:
    """The scale at which rigid bodies with corners of known places have their known size.

    Each corner is triangulated on its own. Within a body each distance between its corners, sides and diagonals, gives
    a ratio. The scale is the median of all ratios and its error their robust spread (MAD), because corners err alike in
    all views.

    Args:
        found: corners in the photo of each camera.
        place_cm: (2,) place of a corner on its body. body_of: the body that a corner belongs to.
        source: name of the reference.
    """
    sightings: dict[Corner, Sighting] = {}
    for corner in sorted({corner for corners in found for corner in corners}):
        views = [number for number, corners in enumerate(found) if corner in corners]
        pixels = np.array([found[number][corner] for number in views])
        sighting = triangulate([cameras[number] for number in views], pixels, least_views=LEAST_VIEWS)
        if sighting is not None:
            sightings[corner] = sighting
    ratios = []
    bodies = list(dict.fromkeys(body_of(corner) for corner in sightings))
    for body in bodies:
        own = [corner for corner in sightings if body_of(corner) == body]
        measured = np.array([sightings[corner].point for corner in own])
        ratios.append(distance_ratios(measured, np.array([place_cm(corner) for corner in own])))
    every = np.concatenate(ratios) if ratios else np.zeros(0)
    if len(every) < 3:
        return NoReference(f"no marker shows in {LEAST_VIEWS} photos that agree on where it is")
    cm_per_su = float(np.median(every))
    error = float(1.4826 * np.median(np.abs(every / cm_per_su - 1)))
    if error > MAX_ERROR:
        return NoReference(f"the sides of the markers scatter by {error:.1%}")
    evidence = {
        "markers": bodies,
        "corners": len(sightings),
        "views_per_corner": float(np.mean([sighting.agreeing.sum() for sighting in sightings.values()])),
        "residual_px": float(np.median([sighting.residual_px for sighting in sightings.values()])),
        "distances": len(every),
    }
    return MarkerFit(Reference(source, cm_per_su, max(error, LEAST_ERROR), evidence), sightings)


def draw_sheet(
    kind: MarkerKind, width_cm: float, height_cm: float, dots_per_cm: int, first_id: int = 0
) -> NDArray[np.uint8]:
    """(H, W) uint8: a sheet of paper with as many markers as fit, or the board, and a ruler of 10 cm to check it by.

    Raises:
        ValueError: the sheet is too small for one marker or for the board.
    """
    import cv2

    sheet = np.full((round(height_cm * dots_per_cm), round(width_cm * dots_per_cm)), 255, np.uint8)
    side, foot = round(kind.side_cm * dots_per_cm), round(2.6 * dots_per_cm)
    # Detection needs a bright rim around the dark square; a tenth of it is more than a bit's width seen aslant.
    gap = round(0.1 * kind.side_cm * dots_per_cm) + dots_per_cm // 2
    if kind.board:
        columns, rows = kind.board
        picture = charuco_board(kind).generateImage((columns * side, rows * side), None, 0, 1)
        pictures, across = [picture], 1
    else:
        dictionary = marker_dictionary(kind.dictionary)
        across = (sheet.shape[1] - gap) // (side + gap)
        down = (sheet.shape[0] - foot - gap) // (side + gap)
        numbers = range(first_id, min(first_id + across * down, len(dictionary.bytesList)))
        pictures = [cv2.aruco.generateImageMarker(dictionary, number, side) for number in numbers]
    height, width = pictures[0].shape if pictures else (side, side)
    if not pictures or width + 2 * gap > sheet.shape[1] or height + gap + foot > sheet.shape[0]:
        raise ValueError(f"{width_cm:g} x {height_cm:g} cm is too small a sheet")
    left = (sheet.shape[1] - across * width - (across - 1) * gap) // 2
    for number, picture in enumerate(pictures):
        x, y = left + number % across * (width + gap), gap + number // across * (height + gap)
        sheet[y : y + height, x : x + width] = picture
    _draw_footer(sheet, kind, dots_per_cm)
    return sheet


def _draw_footer(sheet: NDArray[np.uint8], kind: MarkerKind, dots_per_cm: int) -> None:
    """Draw a ruler of 10 cm and a description of the sheet at the lower rim."""
    import cv2

    height, width = sheet.shape
    left, line = (width - 10 * dots_per_cm) // 2, height - round(1.9 * dots_per_cm)
    thick = max(1, dots_per_cm // 25)
    sheet[line : line + thick, left : left + 10 * dots_per_cm] = 0
    for mark in range(11):
        x = left + mark * dots_per_cm
        tick = round((0.5 if mark % 5 == 0 else 0.3) * dots_per_cm)
        # The outer edges of the first and the last mark are 10 cm apart.
        sheet[line - tick : line, slice(x, x + thick) if mark < 10 else slice(x - thick, x)] = 0
    name = f"{kind.dictionary}, " + (f"board {kind.board[0]}x{kind.board[1]}, " if kind.board else "")
    text = f"10 cm; print at 100 %. {name}black squares of {kind.side_cm:g} cm"
    size = 0.011 * dots_per_cm
    (across, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, thick)
    place = ((width - across) // 2, line + round(0.7 * dots_per_cm))
    cv2.putText(sheet, text, place, cv2.FONT_HERSHEY_SIMPLEX, size, 0, thick, cv2.LINE_AA)


def outline_markers(
    image: NDArray[np.uint8], camera: Camera, sightings: Mapping[Corner, Sighting]
) -> NDArray[np.uint8]:
    """A copy of a photo with a cross where each corner lies in space."""
    return draw_crosses(image, camera, np.array([sighting.point for sighting in sightings.values()]))


def draw_crosses(image: NDArray[np.uint8], camera: Camera, points: NDArray[Any]) -> NDArray[np.uint8]:
    """A copy of a (H, W, 3) photo with a cross on each of (N, 3) scene points."""
    import cv2

    canvas = image.copy()
    arm = max(3, camera.width // 160)
    pixels, depths = camera.project(points)
    for (x, y), depth in zip(pixels, depths, strict=True):
        if depth > 0 and 0 <= x < camera.width and 0 <= y < camera.height:
            place = (int(x), int(y))
            cv2.drawMarker(canvas, place, (255, 0, 255), cv2.MARKER_CROSS, 2 * arm, max(1, camera.width // 1000))
    return canvas
