# SPDX-License-Identifier: Apache-2.0
"""Corners of printed markers as matches: a marker's number identifies its corners, however far apart images are.

Where walls are bare, or photos few, a sheet of markers on the table may be all that images have in common.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.machine import on_all_cores
from ..core.scene import Float64
from ..geometry.printed_markers import find_squares
from .features import Features
from .matching import PairMatches, verify

FAMILIES: Final = (
    *("4x4_1000", "5x5_1000", "6x6_1000", "7x7_1000", "aruco_original"),
    *("apriltag_25h9", "apriltag_36h10", "apriltag_36h11"),
)
"""Dictionaries, by OpenCV's names; smaller ones of a family are the beginning of its largest. (Not AprilTag 16h5, which
texture shows by chance.)"""
LOOKED_AT: Final = 12
"""Number of images from which the printed family is found."""
LEAST_SIGHTINGS: Final = 4
"""Least number of markers in these images. With fewer there are no markers, as single ones may be chance."""

Squares = Mapping[int, Float64]
"""Markers of an image, as `printed_markers.find_squares` gives them."""


def squares_of_images(image: Callable[[int], NDArray[np.uint8]], count: int) -> dict[int, Squares]:
    """The markers in each of `count` images, by the image's number; empty where no family shows.

    Args:
        image: number -> (H, W) grey.
    """
    few = [image(number) for number in range(0, count, max(1, count // LOOKED_AT))]
    sightings = {family: sum(len(find_squares(grey, family)) for grey in few) for family in FAMILIES}
    family = max(FAMILIES, key=lambda name: sightings[name])
    if sightings[family] < LEAST_SIGHTINGS:
        return {}
    found = on_all_cores(lambda number: find_squares(image(number), family, refined=True), range(count))
    return {number: squares for number, squares in enumerate(found) if squares}


def match_marker_corners(
    features: Mapping[int, Features], matches: Mapping[tuple[int, int], PairMatches], squares: Mapping[int, Squares]
) -> tuple[dict[int, Features], dict[tuple[int, int], PairMatches]]:
    """Features with the corners of markers behind them, and the matches that one motion explains with these.

    Args:
        features: of all images. matches: of pairs that fitted together without markers. squares: of the images that
            show any.
    """
    joined = {
        number: of_image.joined(np.concatenate(list(squares[number].values())).astype(np.float32))
        if number in squares
        else of_image
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
