# SPDX-License-Identifier: Apache-2.0
"""Finds the corners of a printed marker by the edges between its cells: when dark cells grow, light cells shrink.

Ink that spreads, and a phone's tone curve and sharpening, move the edges of dark cells outwards or inwards, all by the
same distance. In the outer square alone this looks like a larger or smaller marker (1.5 % on a real sheet of 33 mm
markers, seen 100 px wide). The inner edges show the difference: spread moves those from dark to light one way, and
those from light to dark the other way. The outer edges are not used, because beside the white margin they are off by
more than the others (an error of 0.7 % with them, 0.1 % without).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64

LEAST_CELL_PX: Final = 4.0
"""Smallest cell, px. Smaller cells run into each other."""
REACH: Final = 0.45
"""Distance, in cells, on either side of an edge within which the edge is searched."""
STEPS: Final = 37
"""Places along that way."""
ACROSS: Final = (0.25, 0.5, 0.75)
"""Positions across a cell at which edges are searched."""
LEAST_EDGES: Final = 12
LARGEST_SPREAD: Final = 0.3
"""Largest spread of the dark cells of a print, in cells."""
OUTLIER: Final = 3.0


def fit_to_cells(light: NDArray[np.float32], quad: Float64, dark: NDArray[np.bool_]) -> Float64:
    """(4, 2) px, corners of the marker, corrected for the spread of its dark cells; the given corners where cells are
    too small or their edges are not clear.

    Args:
        light: (H, W) linear light.
        quad: (4, 2) px, corners in the marker's own order (top left first), found from outside.
        dark: (n, n) cells, the dark border included.
    """
    import cv2

    n = len(dark)
    square = np.array([(0, 0), (n, 0), (n, n), (0, n)], np.float32)
    if np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1).min() < LEAST_CELL_PX * n:
        return quad
    to_photo = cv2.getPerspectiveTransform(square, quad.astype(np.float32))
    moved = square.astype(np.float64)
    for axis in (0, 1):
        edges = _find_edges(light, to_photo, dark if axis == 0 else dark.T, axis)
        fitted = _fit(*edges) if len(edges[0]) >= LEAST_EDGES else None
        if fitted is None:
            return quad
        moved[:, axis] += np.column_stack([np.ones(4), square]) @ fitted
    corners: Float64 = cv2.perspectiveTransform(moved[None], to_photo)[0]
    return corners


def _find_edges(
    light: NDArray[np.float32], to_photo: Float64, dark: NDArray[np.bool_], axis: int
) -> tuple[Float64, Float64, Float64]:
    """Edges between cells of one row, inside the marker.

    Returns:
        (E, 2) their nominal places, cells; (E,) their offsets along the axis; (E,) 1 where dark comes first, -1 where
        light does.
    """
    import cv2

    rows, before = np.nonzero(dark[:, 1:] != dark[:, :-1])
    edges, signs = before + 1, np.where(dark[rows, before], 1.0, -1.0)
    rows, edges, signs = (np.repeat(each, len(ACROSS)) for each in (rows, edges, signs))
    across = rows + np.tile(ACROSS, len(rows) // len(ACROSS))
    away = np.linspace(-REACH, REACH, STEPS)
    along = edges[:, None] + away
    places = np.stack([along, np.broadcast_to(across[:, None], along.shape)], axis=-1)
    places = places if axis == 0 else places[..., ::-1]
    pixels = cv2.perspectiveTransform(places.reshape(1, -1, 2), to_photo).reshape(*along.shape, 2) - 0.5
    profile = cv2.remap(light, pixels.astype(np.float32), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    slope = signs[:, None] * (profile[:, 4:] - profile[:, :-4]).astype(np.float64)
    peak = 1 + slope[:, 1:-1].argmax(axis=1)
    left, here, right = (np.take_along_axis(slope, (peak + k)[:, None], 1)[:, 0] for k in (-1, 0, 1))
    bend = left - 2 * here + right
    fine = np.where(bend < 0, 0.5 * (left - right) / np.where(bend < 0, bend, -1), 0.0)
    off = away[2 + peak] + np.clip(fine, -0.5, 0.5) * (away[1] - away[0])
    clear = (peak > 1) & (peak < slope.shape[1] - 2) & (here > 0.3 * np.median(here))
    should = np.column_stack([edges, across] if axis == 0 else [across, edges]).astype(np.float64)
    return should[clear], off[clear], signs[clear]


def _fit(should: Float64, off: Float64, signs: Float64) -> Float64 | None:
    """(3,) offsets of the cells without the spread of the dark ones, as a plane over their places; None if the spread
    is too large for a print."""
    design = np.column_stack([np.ones(len(off)), should, signs])
    kept = np.ones(len(off), bool)
    for _ in range(3):
        if kept.sum() < LEAST_EDGES or len(np.unique(signs[kept])) < 2:
            return None
        found = np.linalg.lstsq(design[kept], off[kept], rcond=None)[0]
        left = np.abs(off - design @ found)
        kept = left <= max(OUTLIER * 1.4826 * float(np.median(left)), 0.02)
    return np.asarray(found[:3], np.float64) if abs(found[3]) < LARGEST_SPREAD else None
