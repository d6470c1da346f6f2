# SPDX-License-Identifier: Apache-2.0
"""The scale from two points a known distance apart, picked by hand in several photos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera
from ..geometry.triangulation import point_of_picks
from .references import LEAST_ERROR, NoReference, Reference

MAX_ERROR: Final = 0.03


def scale_from_distance(
    cameras: Sequence[Camera], picks: Mapping[str, Mapping[str, NDArray[np.float64]]], distance_cm: float
) -> tuple[Reference, NDArray[np.float64]] | NoReference:
    """The scale at which two points have their known distance, and (2, 3) the points, su.

    Args:
        picks: point -> image -> (2,) px in the undistorted image; two points, each in at least two images.
    """
    by_name = {camera.name: camera for camera in cameras}
    if len(picks) != 2:
        return NoReference(f"{len(picks)} points were picked where two are needed")
    points, sigmas = [], []
    for name, places in picks.items():
        seen = [image for image in places if image in by_name]
        if len(seen) < 2:
            return NoReference(f"point {name} was picked in {len(seen)} of the placed images, 2 are needed")
        pixels = np.array([places[image] for image in seen])
        picked = point_of_picks([by_name[image] for image in seen], pixels)
        if picked is None:
            return NoReference(f"the picks of point {name} do not meet in space")
        points.append(picked.point)
        sigmas.append(picked.error_su)
    measured = float(np.linalg.norm(points[0] - points[1]))
    if measured <= 0:
        return NoReference("both points lie at the same place")
    error = max(float(np.hypot(sigmas[0], sigmas[1])) / measured, LEAST_ERROR)
    if error > MAX_ERROR:
        return NoReference(
            f"the two points give their distance to {error:.0%} only; pick them in more images, from more sides"
        )
    return Reference("distance", distance_cm / measured, error, {"distance_su": measured}), np.array(points)
