# SPDX-License-Identifier: Apache-2.0
"""Standard errors of the traits of a plant and of its bolls, from the usual sources of error.

Lengths err with the scale and by a part of a pixel. Volumes err with the scale; with the edges of the masks, both each
view's own error and the common one of all views; with a boll's shape; and, where bolls touch, with the border between
them. count_distribution.py has the effects of a wrong count. The constants marked "fitted" were chosen so that
intervals hold the truth of films of tests/accuracy/interval_coverage.py and of path-traced plants
(docs/notes/stated_errors.md says which, and how well).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.measurements import BollTraits, Scale
from ..core.scene import Float64

COVERED: Final = 1.96
"""Standard errors on either side of a value that make its 95 % interval."""
SIZE_PX: Final = 0.25
"""Standard error of height and of canopy besides the scale's, in pixels of the training images. Fitted."""
SMEARED_SIZE: Final = 0.04
"""Standard error of canopy, as a share of the motion blur, because a walk around a plant smears it sideways. Fitted."""
SHAPE: Final = 0.33
"""Relative standard error of a boll's volume for each unit of 1 - roundness, where roundness is the volume of its hull
by that of a ball of its diameter. Of a less round boll the images show a smaller part of the hull. Fitted."""
EDGE_PX: Final = 0.1
"""Standard error of a boll's diameter in one view. Fitted."""
ALIKE: Final = 8
"""Number of views that err alike, because they see the same rim."""
SHARED_EDGE_PX: Final = 0.02
"""Standard error of the edges that all masks of a plant have in common, at either side of a boll, ..."""
SHARED_BLUR: Final = 0.004
"""... and share of the motion blur by which the edges lie farther out. Both fitted."""
SEEN_ALL_ROUND_DEG: Final = 60.0
"""Largest gap of a walk that has seen all sides."""
UNSEEN: Final = 0.04
"""Relative standard error of all volumes by sides that no image shows, for each further 100 degrees that the walk
lacks. Fitted to five simulated half turns, which lacked 160 degrees and 2 to 6 % of the volume."""
LINT_EDGE: Final = 0.02
"""Relative standard error of all volumes by where the lint ends: the probability of lint at its edge differs between
kinds of bolls. Of 20 simulated plants of all kinds (docs/notes/stated_errors.md), without those whose locks count as
bolls."""
IN_PARTS: Final = 0.12
"""Relative standard error of all volumes for each unit of the share of parts that are joined: the hull around locks
that hang apart is too large, that of a boll without its hidden locks too small. Fitted to 29 plants of `make same-boll`
by likelihood; 19 others give 0.14 (docs/notes/stated_errors.md)."""
BLURRED_SHARE: Final = 0.25
"""Motion blur, as a share of a boll's width, from which the plant has a flag."""
NEIGHBOUR: Final = 1.2
"""Distance of their middles, in mean diameters, up to which two bolls may touch."""
PARTED: Final = 1.3
"""Relative standard error of a touching boll's volume from its border with its neighbour, times the square of how much
nearer than `NEIGHBOUR` they are: 0.05 where they only just touch, 0.3 deep in each other. Fitted."""
UNROUND_FLAG: Final = "unround"
UNROUND: Final = 0.045
"""A touching boll is perhaps two in one if its roundness (volume by that of a ball of its diameter) is this much below
the median of the plant's bolls, ..."""
IS_TWO: Final = 0.45
"""... and it is two with this probability: 16 of 36 on films of tests/accuracy/interval_coverage.py; 12 of 543 other
touching bolls were. ..."""
AS_IF_NEAR: Final = 0.8
"""... Its volume errs as if a neighbour were at this distance."""
PARTED_IN_SUM: Final = 0.5
"""Share of that error that counts in the plant's volume: one of two bolls gains what the other loses, and a part of a
lost boll's volume remains. Fitted."""
HALVES_DIFFER: Final = 0.05
"""Difference of the counts by either half of the images, as a share of the larger one, from which the plant has a flag.
A difference of one boll does not matter."""
CROWDED_SHARE: Final = 0.3
"""Share of touching bolls from which the plant has a flag."""


@dataclass(frozen=True)
class Conditions:
    """What affects the errors of all bolls of a plant: how it was filmed, and the kind of its bolls."""

    blur_px: float = 0.0
    """Motion blur of the training images."""
    gap_deg: float = 0.0
    """Largest part of the walk around the plant without an image."""
    whole: bool = True
    """Whether there are images that show the plant whole; bolls beyond the frame are unknown."""
    joining: float = 0.0
    """Share of the parts of its bolls that are joined to others: none if all bolls were seen whole, two thirds if each
    is three locks."""


USUAL_CONDITIONS: Final = Conditions()


def nearest_neighbours(centres: Float64, diameters: Float64) -> Float64:
    """(B,) distance of each boll's nearest neighbour, in mean diameters of the two; infinite without one, and where
    place or diameter is NaN.

    Args:
        centres: (B, 3). diameters: (B,), in the same unit.
    """
    if not len(centres):
        return np.zeros(0)
    away = np.linalg.norm(centres[:, None] - centres, axis=2) / (0.5 * (diameters[:, None] + diameters))
    np.fill_diagonal(away, np.inf)
    nearest: Float64 = np.where(np.isnan(away), np.inf, away).min(axis=1)
    return nearest


def find_touching(nearest: Float64) -> NDArray[np.bool_]:
    """(B,) which bolls may touch another, by `nearest_neighbours`."""
    return nearest < NEIGHBOUR


def find_unround(nearest: Float64, roundness: Float64) -> NDArray[np.bool_]:
    """(B,) which bolls are perhaps two in one, by their shape.

    Args:
        nearest: (B,) from `nearest_neighbours`. roundness: (B,) volume by that of a ball of the same diameter.
    """
    known = roundness[np.isfinite(roundness)]
    if not len(known):
        return np.zeros(len(nearest), bool)
    return find_touching(nearest) & (roundness < np.median(known) - UNROUND)


def parted_error(nearest: Float64) -> Float64:
    """(B,) relative standard error of volumes by the border with a neighbour at this distance; 0 for bolls that stand
    apart."""
    return PARTED * np.maximum(NEIGHBOUR - nearest, 0.0) ** 2


def size_error_cm(
    size_cm: float, scale: Scale | None, pixel_cm: float, others_cm: Sequence[float] = (), blur_px: float = 0.0
) -> float:
    """Standard error of the plant's height or canopy.

    Args:
        others_cm: other possible values.
        blur_px: motion blur along it.
    """
    if scale is None:
        return np.nan
    apart_cm = max((abs(other - size_cm) for other in others_cm), default=0.0)
    edges_cm = np.hypot(SIZE_PX, SMEARED_SIZE * blur_px) * pixel_cm
    return float(np.linalg.norm([size_cm * scale.relative_error, edges_cm, apart_cm]))


def boll_volume_error(
    diameter_su: float,
    volume_su3: float,
    n_views: int,
    scale: Scale | None,
    pixel_su: float,
    nearest: float = np.inf,
    conditions: Conditions = USUAL_CONDITIONS,
) -> float:
    """Relative standard error of a boll's volume; NaN without a scale or a diameter.

    It has a part that all bolls of the plant share, from scale and edges, and a part of its own, from its shape, a
    neighbour, and its diameter in each view that shows it; only one view in `ALIKE` counts. The relative error of a
    diameter counts three times in the volume.

    Args:
        volume_su3: of its convex hull; diameter_su: mean width of it.
        nearest: distance of its nearest neighbour, from `nearest_neighbours`.
    """
    if scale is None or not diameter_su > 0:
        return np.nan
    shape = SHAPE * max(1 - volume_su3 / (np.pi / 6 * diameter_su**3), 0.0)
    edge = 3 * EDGE_PX * pixel_su / diameter_su / np.sqrt(max(n_views / ALIKE, 1))
    of_plant = np.hypot(3 * scale.relative_error, _shared(diameter_su, pixel_su, conditions))
    return float(np.linalg.norm([of_plant, shape, edge, parted_error(np.array(nearest))]))


def plant_volume_error_cm3(
    bolls: Sequence[BollTraits],
    nearest: Float64,
    scale: Scale | None,
    pixel_cm: float,
    conditions: Conditions = USUAL_CONDITIONS,
) -> float:
    """Standard error of the sum of the volumes, if each is one boll: shared errors add up, the others add in squares.


    Args:
        nearest: (B,) from `nearest_neighbours`.
    """
    if scale is None or not conditions.whole:
        return np.nan
    measured = [row for row, boll in enumerate(bolls) if np.isfinite(boll.volume_cm3)]
    known = [bolls[row] for row in measured]
    volumes = np.array([boll.volume_cm3 for boll in known])
    by_scale = 3 * scale.relative_error * volumes
    by_edges = volumes * [_shared(boll.diameter_cm, pixel_cm, conditions) for boll in known]
    parted = (1 - PARTED_IN_SUM**2) * (parted_error(nearest[measured]) * volumes) ** 2
    own = np.array([boll.volume_error_cm3 for boll in known]) ** 2 - by_scale**2 - by_edges**2 - parted
    return float(np.sqrt(by_scale.sum() ** 2 + by_edges.sum() ** 2 + np.maximum(own, 0.0).sum()))


def _shared(diameter: float, pixel: float, conditions: Conditions) -> float:
    """The part of a volume's relative error that all bolls share: edges of masks that lie too far out, sides that were
    not filmed, and bolls that come in parts. Both lengths are in one unit."""
    by_edges = 6 * np.hypot(SHARED_EDGE_PX, SHARED_BLUR * conditions.blur_px) * pixel / diameter
    by_unseen = UNSEEN * max(conditions.gap_deg - SEEN_ALL_ROUND_DEG, 0.0) / 100
    return float(np.linalg.norm([by_edges, by_unseen, LINT_EDGE, IN_PARTS * conditions.joining]))


def blurs_bolls(blur_px: float, pixel: float, diameters: Float64) -> bool:
    """Whether the plant has a flag for motion blur, relative to the width of the bolls.

    Args:
        pixel, diameters: in one unit; NaN where a boll has none.
    """
    known = diameters[np.isfinite(diameters)]
    return len(known) > 0 and bool(blur_px * pixel > BLURRED_SHARE * np.median(known))


def halves_disagree(halves: tuple[int, int] | None) -> bool:
    """Whether the plant has a flag because the counts by two halves of the images differ."""
    return halves is not None and abs(halves[0] - halves[1]) > max(1.0, HALVES_DIFFER * max(halves))


def interval(value: float, error: float, missing: float = 0.0) -> tuple[float, float] | None:
    """Ends of the 95 % interval of a trait that is never negative; None where value or error is NaN.

    Args:
        missing: expected difference of the true value from `value`. The interval lies around the sum of both, and it
            also holds `value`.
    """
    if not np.isfinite(value + error + missing):
        return None
    low, high = min(missing - COVERED * error, 0.0), max(missing + COVERED * error, 0.0)
    return max(value + low, 0.0), value + high
