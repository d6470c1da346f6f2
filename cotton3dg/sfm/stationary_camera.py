# SPDX-License-Identifier: Apache-2.0
"""Whether a camera stood still: then most of its matches stay where they are, and only a turning thing moves.

Structure from motion would try for a quarter of an hour to place such cameras, which are all the same, and give up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import CaptureFailed
from .features import Features
from .matching import PairMatches

MAX_STANDING_PCT: Final = 50.0
"""Walks had 0 to 15 % (a bare room, in which little but the plant is matched), a turntable 99 %."""
APART: Final = 3
"""Least distance of a pair, in images, because neighbours may have been taken from nearly one place."""
LOOKED_AT: Final = 12
"""Number of pairs that are compared, about."""
TREMBLE: Final = 0.05
"""Share of the longer side by which the whole picture moves if a camera is held by hand but stands still."""
TOLERANCE: Final = 0.003
"""Share of the longer side by which a place that stands still differs from the motion of the whole picture."""


def pairs_far_apart(pairs: Sequence[tuple[int, int]], images: int) -> list[tuple[int, int]]:
    """A few pairs of a capture of `images` images that are some way apart."""
    apart = [pair for pair in pairs if APART <= abs(pair[0] - pair[1]) <= images - APART]
    return apart[:: max(1, len(apart) // LOOKED_AT)]


def require_walk(features: Mapping[int, Features], matches: Mapping[tuple[int, int], PairMatches]) -> None:
    """Check, before cameras are placed, that the camera moved.

    Args:
        features: by number of the image. matches: of `pairs_far_apart`.
    Raises:
        CaptureFailed: the camera stood still.
    """
    standing = standing_pct(features, matches)
    if standing is not None and standing > MAX_STANDING_PCT:
        raise CaptureFailed(
            f"the camera stands still, though the plant may turn ({standing:.0f} % of what two images have in common is"
            " at the same place in both); film one slow full turn, walking around the plant"
        )


def standing_pct(features: Mapping[int, Features], matches: Mapping[tuple[int, int], PairMatches]) -> float | None:
    """Share of the matches that stay where they are, but for a tremble of the whole picture: the median over the
    pairs; None without any."""
    side_px = max((float(of_image.places_px.max(initial=0)) for of_image in features.values()), default=0.0)
    shares = [
        _share(features[i].places_px[found.rows[:, 0]], features[j].places_px[found.rows[:, 1]], side_px)
        for (i, j), found in matches.items()
    ]
    return 100 * float(np.median(shares)) if shares else None


def _share(first: NDArray[np.float32], second: NDArray[np.float32], side_px: float) -> float:
    found, _ = cv2.estimateAffinePartial2D(first, second, ransacReprojThreshold=TOLERANCE * side_px)
    if found is None:
        return 0.0
    moved = first @ found[:, :2].T + found[:, 2]
    stays = np.linalg.norm(moved - first, axis=1) < TREMBLE * side_px
    return float((stays & (np.linalg.norm(moved - second, axis=1) < TOLERANCE * side_px)).mean())
