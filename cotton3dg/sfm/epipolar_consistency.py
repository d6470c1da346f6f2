"""Whether the cameras of a model explain what its images have in common; a model that is bent or folded does not.

The mapper leaves out what does not fit, so that its reprojection error is small in a wrong model, too. Matches of pairs
of images that it had no use for are the witnesses: where the two cameras contradict them, one of them is wrong.
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
"""Matches from which on a pair's word has full weight; that of others has less in proportion. Things that look alike
agree by chance, but in few places: of 190 pairs of photos of a board of markers, placed to a seventh of a per cent, 58
were contradicted, with 22 matches in the middle, where the others had 126."""


def contradicted_pct(
    model: Any, names: list[str], features: Mapping[int, Features], matches: Mapping[tuple[int, int], PairMatches]
) -> float | None:
    """Share of the pairs, both of whose images are placed, whose matches the cameras contradict, those with few matches
    counting less; None without any.

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
    return np.abs((two * line).sum(axis=1)) / np.sqrt(np.maximum(slope, 1e-12))
