# SPDX-License-Identifier: Apache-2.0
"""Ink that spreads: a marker's corners are where they were printed, whatever its dark cells have swallowed."""

import cv2
import numpy as np
import pytest

from cotton3dg.scale.marker_cells import fit_to_cells
from cotton3dg.scale.markers import MarkerKind, find_markers, marker_cells, refine_quad

CELL_PX = 40
"""Of the print."""
FINER = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1]])
"""From a photo's pixels to those of one four times as fine, both counted from the middle of the first."""
KIND = MarkerKind("7x7_1000", 3.3)
NUMBER = 12


def printed(spread_px: float) -> np.ndarray:
    """A marker with a margin, at `CELL_PX` a cell, whose dark has grown by so much at every edge (or shrunk)."""
    cells = marker_cells(KIND.dictionary, NUMBER)
    sheet = np.kron(~np.pad(cells, 2), np.ones((CELL_PX, CELL_PX))).astype(np.uint8) * 255
    size = 2 * round(abs(spread_px)) + 1
    kernel = np.ones((size, size), np.uint8)
    return cv2.erode(sheet, kernel) if spread_px > 0 else cv2.dilate(sheet, kernel)


def photographed(sheet: np.ndarray, corners_px: np.ndarray) -> np.ndarray:
    """(600, 800) grey photo in which the marker, without its spread, has these corners."""
    n = len(marker_cells(KIND.dictionary, NUMBER))
    square = CELL_PX * (2 + np.array([(0, 0), (n, 0), (n, n), (0, n)], np.float32)) - 0.5
    to_photo = cv2.getPerspectiveTransform(square, (corners_px - 0.5).astype(np.float32))
    fine = cv2.warpPerspective(sheet, FINER @ to_photo, (3200, 2400), borderValue=255)
    light = cv2.GaussianBlur((fine / 255.0) * 0.8 + 0.05, None, 3.0)
    return (255 * cv2.resize(light, (800, 600), interpolation=cv2.INTER_AREA) ** (1 / 2.2)).astype(np.uint8)


TRUE_PX = np.array([[300.3, 200.6], [405.2, 190.1], [412.7, 300.4], [296.1, 296.8]])


@pytest.mark.parametrize("spread_px", [-4, -2, 0, 2, 4])
def test_corners_are_those_of_the_print(spread_px):
    """4 px of the print are 1.1 px of the photo, 2 % of the marker's width."""
    photo = photographed(printed(spread_px), TRUE_PX)
    light = (photo / np.float32(255)) ** np.float32(2.2)
    outer = refine_quad(light, TRUE_PX)
    found = fit_to_cells(light, outer, marker_cells(KIND.dictionary, NUMBER))
    assert np.abs(found - TRUE_PX).max() < 0.25
    if spread_px:
        assert np.abs(outer - TRUE_PX).max() > 2 * np.abs(found - TRUE_PX).max()
    corners = find_markers(np.repeat(photo[..., None], 3, axis=2), KIND)
    assert np.abs(np.array([corners["marker", NUMBER, k] for k in range(4)]) - TRUE_PX).max() < 0.25


def test_cells_that_cannot_be_seen_leave_the_corners_alone():
    cells = marker_cells(KIND.dictionary, NUMBER)
    light = np.random.default_rng(0).uniform(0, 1, (600, 800)).astype(np.float32)
    small = TRUE_PX[0] + 0.3 * (TRUE_PX - TRUE_PX[0])
    assert fit_to_cells(light, small, cells) is small
    flat = np.full((600, 800), 0.5, np.float32)
    assert fit_to_cells(flat, TRUE_PX, cells) is TRUE_PX
    moved = fit_to_cells(light, TRUE_PX, cells)
    assert np.isfinite(moved).all()
