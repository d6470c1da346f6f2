"""Corners of printed markers as matches: a marker's number says which corner is which, however far apart images are.

Where walls are bare, or photos few, a sheet of markers on the table may be all that images have in common.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.machine import on_all_cores
from .features import Features
from .matching import PairMatches, verify

FAMILIES = (
    *("4X4_1000", "5X5_1000", "6X6_1000", "7X7_1000", "ARUCO_ORIGINAL"),
    *("APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11"),
)
"""Dictionaries, by OpenCV's names; smaller ones of a family are the beginning of its largest. (Not AprilTag 16h5, which
texture shows by chance.)"""
LOOKED_AT = 12
"""Images that tell which family was printed."""
LEAST_SIGHTINGS = 4
"""Markers in these images, below which there are none: single ones may be chance."""

Squares = dict[int, NDArray[np.float32]]
"""By the marker's number (4, 2) px of its corners, in the order of its kind; the first pixel's corner is (0, 0)."""


def find_squares(image: Callable[[int], NDArray[np.uint8]], count: int) -> dict[int, Squares]:
    """The markers in each of so many images, by the image's number; empty where no family shows.

    Args:
        image: number -> (H, W) grey.
    """
    few = [image(number) for number in range(0, count, max(1, count // LOOKED_AT))]
    sightings = {family: sum(len(squares_of(grey, family)) for grey in few) for family in FAMILIES}
    family = max(FAMILIES, key=lambda name: sightings[name])
    if sightings[family] < LEAST_SIGHTINGS:
        return {}
    found = on_all_cores(lambda number: squares_of(image(number), family), range(count))
    return {number: squares for number, squares in enumerate(found) if squares}


def squares_of(grey: NDArray[np.uint8], family: str) -> Squares:
    """Those of one (H, W) image; a number that it shows twice is left out."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{family}"))
    settings = cv2.aruco.DetectorParameters()
    settings.minMarkerPerimeterRate = 0.02
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    quads, ids, _ = cv2.aruco.ArucoDetector(dictionary, settings).detectMarkers(grey)
    numbers = [] if ids is None else ids.ravel().tolist()
    return {
        number: quad.reshape(4, 2).astype(np.float32) + np.float32(0.5)
        for number, quad in zip(numbers, quads, strict=True)
        if numbers.count(number) == 1
    }


def tie(
    features: Mapping[int, Features], matches: Mapping[tuple[int, int], PairMatches], squares: Mapping[int, Squares]
) -> tuple[dict[int, Features], dict[tuple[int, int], PairMatches]]:
    """Features with the corners of markers behind them, and the matches that one motion explains with these.

    Args:
        features: of all images. matches: of pairs that fitted together without. squares: of those that show any.
    """
    joined = {
        number: of_image.joined(np.concatenate(list(squares[number].values()))) if number in squares else of_image
        for number, of_image in features.items()
    }
    pairs = [pair for pair in combinations(sorted(squares), 2) if squares[pair[0]].keys() & squares[pair[1]].keys()]

    def with_corners(pair: tuple[int, int]) -> PairMatches | None:
        rows = [_corner_rows(features, squares, pair)]
        if pair in matches:
            rows.insert(0, matches[pair].rows)
        first, second = (joined[number].places_px for number in pair)
        return verify(first, second, np.concatenate(rows))

    found = dict(zip(pairs, on_all_cores(with_corners, pairs), strict=True))
    kept = {pair: tied for pair, tied in found.items() if tied is not None}
    return joined, dict(sorted((dict(matches) | kept).items()))


def _corner_rows(
    features: Mapping[int, Features], squares: Mapping[int, Squares], pair: Sequence[int]
) -> NDArray[np.uint32]:
    """(M, 2) rows, among the joined features, of the corners that both images show."""
    starts = [
        {marker: len(features[number].places_px) + 4 * k for k, marker in enumerate(squares[number])} for number in pair
    ]
    both = [marker for marker in starts[0] if marker in starts[1]]
    rows = [[(starts[0][marker] + k, starts[1][marker] + k) for k in range(4)] for marker in both]
    return np.array(rows, np.uint32).reshape(-1, 2)
