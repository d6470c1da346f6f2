# SPDX-License-Identifier: Apache-2.0
"""Which features of two images show the same place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import _native
from ..core.machine import on_all_cores
from .features import ROOT_SIFT_NORM, Features

MAX_ANGLE: Final = 0.7
"""rad between descriptors."""
MAX_RATIO: Final = 0.8
"""Largest ratio of the angle to the most similar descriptor to the angle to the next one (Lowe 2004)."""
MAX_ERROR_PX: Final = 4.0
"""Distance from the epipolar line."""
CONFIDENCE: Final = 0.999
MAX_TRIALS: Final = 2000
MIN_MATCHES: Final = 15

ALL_PAIRS: Final = 500
"""Number of pairs, of some 30 images, up to which all are matched whole. Images far apart share too little for a quick
comparison."""
PREVIEWED: Final = 512
"""Number of an image's features, the first ones, that decide to which other images it is similar."""
ALIKE: Final = 4
"""Number of matches among these from which on images are alike."""
FEW_ALIKE: Final = 3
"""An image with fewer similar images is matched with all."""


@dataclass(frozen=True)
class PairMatches:
    """Matches that one motion of the camera explains."""

    fundamental: NDArray[np.float64]
    """(3, 3), from the first image to the second, px."""
    rows: NDArray[np.uint32]
    """(M, 2) of the features of the first and of the second image."""


def match(first: Features, second: Features) -> PairMatches | None:
    """The matches of two images; None when fewer than `MIN_MATCHES` fit together."""
    return verify(first.places_px, second.places_px, match_descriptors(first.descriptors, second.descriptors))


def match_pairs(
    features: Mapping[int, Features], pairs: Sequence[tuple[int, int]]
) -> dict[tuple[int, int], PairMatches]:
    """The pairs of images that fit together, with their matches."""
    found = on_all_cores(lambda pair: match(features[pair[0]], features[pair[1]]), pairs)
    return {pair: matches for pair, matches in zip(pairs, found, strict=True) if matches is not None}


def find_similar_pairs(
    images: Sequence[Features], pairs: Sequence[tuple[int, int]], most: int
) -> list[tuple[int, int]]:
    """The pairs that are worth matching whole: those of each image with the `most` most similar images.

    Source: preemptive matching (Wu 2013), but the most similar are kept instead of all above a limit.
    """
    if len(pairs) <= ALL_PAIRS:
        return list(pairs)
    largest = [of_image.descriptors[:PREVIEWED] for of_image in images]
    common = on_all_cores(lambda pair: len(match_descriptors(largest[pair[0]], largest[pair[1]])), pairs)
    of_image: dict[int, list[tuple[int, tuple[int, int]]]] = {}
    for pair, n in zip(pairs, common, strict=True):
        for image in pair:
            of_image.setdefault(image, []).append((n, pair))
    kept: set[tuple[int, int]] = set()
    for candidates in of_image.values():
        alike = sorted((candidate for candidate in candidates if candidate[0] >= ALIKE), reverse=True)
        chosen = alike[:most] if len(alike) >= FEW_ALIKE else candidates
        kept.update(pair for _, pair in chosen)
    return sorted(kept)


def match_descriptors(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Rows (M, 2) of descriptors that are each other's nearest and much nearer than the next ones, as COLMAP has it."""
    of_first, of_second = _native.match_descriptors(first, second)
    rows = np.flatnonzero(_distinct(of_first))
    others = of_first[2, rows]
    mutual = _distinct(of_second)[others] & (of_second[2, others] == rows)
    return np.column_stack([rows[mutual], others[mutual]]).astype(np.uint32)


def _distinct(neighbours: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Which rows have a nearest neighbour that is near, and much nearer than the next one."""
    best, second = np.arccos(np.clip(neighbours[:2] / ROOT_SIFT_NORM**2, 0, 1))
    distinct: NDArray[np.bool_] = (neighbours[2] >= 0) & (best < MAX_ANGLE) & (best < MAX_RATIO * second)
    return distinct


def verify(first_px: NDArray[Any], second_px: NDArray[Any], rows: NDArray[np.uint32]) -> PairMatches | None:
    """The matches that one fundamental matrix explains, by graph-cut RANSAC (Barath and Matas 2018), by OpenCV."""
    if len(rows) < MIN_MATCHES:
        return None
    places = first_px[rows[:, 0]], second_px[rows[:, 1]]
    try:
        found, inliers = cv2.findFundamentalMat(*places, cv2.USAC_ACCURATE, MAX_ERROR_PX, CONFIDENCE, MAX_TRIALS)
    except cv2.error:  # raised by OpenCV 5 where it finds no matrix at all
        return None
    if found is None or found.shape != (3, 3) or not np.isfinite(found).all():
        return None
    kept = rows[inliers.ravel() > 0]
    return PairMatches(found, kept) if len(kept) >= MIN_MATCHES else None
