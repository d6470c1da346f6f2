# SPDX-License-Identifier: Apache-2.0
"""Whether the cameras of a model explain the matches of its images; those of a bent or folded model do not.

The mapper leaves out matches that do not fit, so its reprojection error is small in a wrong model, too. The matches of
pairs of images that the mapper did not use are the test: where the two cameras contradict them, a camera is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from ..core.scene import Float64
from .features import Features
from .matching import PairMatches

MAX_ERROR_PX: Final = 8.0
"""Median distance of a pair's matches from their epipolar lines; twice what made them matches."""
FULL_WITNESS: Final = 100
"""Number of matches from which on a pair has full weight; pairs with fewer matches weigh less in proportion. Things
that look alike match by chance, but in few places: of 190 pairs of photos of a board of markers, placed to a seventh of
a per cent, 58 were contradicted, with 22 matches in the median, where the others had 126."""


def contradicted_pct(
    model: Any, names: list[str], features: Mapping[int, Features], matches: Mapping[tuple[int, int], PairMatches]
) -> float | None:
    """Share of the pairs of placed images whose matches the cameras contradict; pairs with few matches count less. None
    without any pair.

    Args:
        model: a pycolmap.Reconstruction. features, matches: of the images, by their numbers in `names`.
    """
    images = {model.image(i).name: model.image(i) for i in model.reg_image_ids()}
    rays: dict[int, Float64] = {}
    errors, weights = [], []
    for pair, found in matches.items():
        if not all(names[number] in images for number in pair):
            continue
        for number in pair:
            if number not in rays:
                camera = images[names[number]].camera
                rays[number] = camera.cam_from_img(features[number].places_px.astype(np.float64))
        first, second = (images[names[number]] for number in pair)
        focal_px = float(first.camera.mean_focal_length())
        between = second.cam_from_world() * first.cam_from_world().inverse()
        both = (rays[number][found.rows[:, k]] for k, number in enumerate(pair))
        errors.append(focal_px * float(np.median(sampson(between, *both))))
        weights.append(min(len(found.rows), FULL_WITNESS))
    return 100 * float(np.average(np.array(errors) > MAX_ERROR_PX, weights=weights)) if errors else None


def sampson(between: Any, first: Float64, second: Float64) -> Float64:
    """(N,) Sampson's distance of matches from their epipolar lines (Hartley and Zisserman 2004, eq. 11.9).

    Args:
        between: pycolmap.Rigid3d, from the first camera to the second. first, second: (N, 2) on the plane z = 1.
    """
    rotation, (x, y, z) = between.rotation.matrix(), between.translation
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation
    one, two = (np.column_stack([rays, np.ones(len(rays))]) for rays in (first, second))
    line, back = one @ essential.T, two @ essential
    slope = (line[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1)
    distances: Float64 = np.abs((two * line).sum(axis=1)) / np.sqrt(np.maximum(slope, 1e-12))
    return distances
