"""Standard errors of the traits of a plant and of its bolls, from the usual sources of error.

Lengths err with the scale and by a part of a pixel. Volumes err with the scale; with the edges of the masks, both each
view's own error and the common one of all views; with a boll's shape; and, where bolls touch, with the border between
them. A count errs with the views' agreement on each boll and, where bolls touch, with bolls that are lost in another or
counted twice. The constants marked "fitted" were chosen so that intervals hold the truth of films of
tests/accuracy/interval_coverage.py and of path-traced plants (docs/notes/stated_errors.md says which, and how well).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.measurements import BollTraits, Scale

COVERED: Final = 1.96
"""Standard errors on either side of a value that make its 95 % interval."""
SIZE_PX: Final = 0.25
"""Standard error of height and of canopy besides the scale's, in pixels of the training images. Fitted."""
SMEARED_SIZE: Final = 0.04
"""Standard error of canopy, as a share of the motion blur, because a walk around a plant smears it sideways. Fitted."""
SHAPE: Final = 0.33
"""Relative standard error of a boll's volume, whatever its size in the images, for each share by which its hull falls
short of a ball of its diameter: the less round it is, the more of the hull is lint that no image shows. Fitted."""
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
BEHIND: Final = 0.03
"""Probability that others hide a boll all along a walk that lacks 280 degrees, so that it is not counted. Of two
simulated plants filmed so, one lost one of 16 bolls. Walks that lack 160 degrees lost none of 77."""
BLURRED_SHARE: Final = 0.25
"""Motion blur, as a share of a boll's width, from which the plant has a flag."""
NEIGHBOUR: Final = 1.2
"""Distance of their middles, in mean diameters, up to which two bolls may touch."""
PARTED: Final = 1.3
"""Relative standard error of a touching boll's volume from its border with its neighbour, times the square of how much
nearer than `NEIGHBOUR` they are: 0.05 where they only just touch, 0.3 deep in each other. Fitted."""
UNROUND: Final = 0.045
"""A touching boll is perhaps two in one if the ratio of its volume to a ball of its diameter is this much less than the
median of the plant's bolls, ..."""
IS_TWO: Final = 0.45
"""... and is so with this probability: 16 of 36 on films of tests/accuracy/interval_coverage.py (other touching bolls:
12 of 543). ..."""
AS_IF_NEAR: Final = 0.8
"""... Its volume errs as if a neighbour were no farther away."""
PARTED_IN_SUM: Final = 0.5
"""Share of that error that counts in the plant's volume: one of two bolls gains what the other loses, and a part of a
lost boll's volume remains. Fitted."""
MISCOUNTED: Final = 0.03
"""Probability that a touching boll is lost, or counted twice. Fitted."""
BY_COLOUR_VOLUME: Final = 0.09
"""Relative standard error of the plant's volume from masks by colour alone (`lint`), which lose shaded sides: -16 to
+15 % on six path-traced plants."""
BY_COLOUR_MISCOUNTED: Final = 0.45
"""Standard error of the count from such masks, as a share of the touching bolls: they merge all over the plant or
nowhere."""
HALVES_DIFFER: Final = 0.05
"""Difference of the counts by either half of the images, as a share of the larger one, from which the plant has a flag.
A difference of one boll does not matter."""
CROWDED_SHARE: Final = 0.3
"""Share of touching bolls from which the plant has a flag."""


@dataclass(frozen=True)
class Filming:
    """How the plant was filmed, as far as it affects the errors of all its bolls."""

    blur_px: float = 0.0
    """Motion blur of the training images."""
    gap_deg: float = 0.0
    """Largest part of the walk around the plant without an image."""
    whole: bool = True
    """Whether there are images that show the plant whole; bolls beyond the frame are unknown."""


WELL_FILMED: Final = Filming()


def nearest_neighbours(centres: NDArray, diameters: NDArray) -> NDArray[np.float64]:
    """(B,) distance of each boll's nearest neighbour, in mean diameters of the two; infinite without one, and where
    place or diameter is NaN.

    Args:
        centres: (B, 3). diameters: (B,), in the same unit.
    """
    if not len(centres):
        return np.zeros(0)
    away = np.linalg.norm(centres[:, None] - centres, axis=2) / (0.5 * (diameters[:, None] + diameters))
    np.fill_diagonal(away, np.inf)
    return np.where(np.isnan(away), np.inf, away).min(axis=1)


def find_touching(nearest: NDArray) -> NDArray[np.bool_]:
    """(B,) which bolls may touch another, by `nearest_neighbours`."""
    return nearest < NEIGHBOUR


def find_unround(nearest: NDArray, roundness: NDArray) -> NDArray[np.bool_]:
    """(B,) which bolls are perhaps two in one, by their shape.

    Args:
        nearest: (B,) from `nearest_neighbours`. roundness: (B,) volume by that of a ball of the same diameter.
    """
    known = roundness[np.isfinite(roundness)]
    if not len(known):
        return np.zeros(len(nearest), bool)
    return find_touching(nearest) & (roundness < np.median(known) - UNROUND)


def parted_error(nearest: NDArray) -> NDArray[np.float64]:
    """(B,) relative standard error of volumes from the border with the neighbour at this distance; 0 for bolls that
    stand apart."""
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
    filming: Filming = WELL_FILMED,
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
    of_plant = np.hypot(3 * scale.relative_error, _shared(diameter_su, pixel_su, filming))
    return float(np.linalg.norm([of_plant, shape, edge, parted_error(np.array(nearest))]))


def plant_volume_error_cm3(
    bolls: Sequence[BollTraits],
    nearest: NDArray[np.float64],
    scale: Scale | None,
    pixel_cm: float,
    by_colour: bool = False,
    filming: Filming = WELL_FILMED,
) -> float:
    """Standard error of the sum of the bolls' volumes: shared errors add up, the others add in squares.

    Args:
        nearest: (B,) from `nearest_neighbours`. by_colour: whether the masks are by colour alone.
    """
    if scale is None or not filming.whole:
        return np.nan
    measured = [row for row, boll in enumerate(bolls) if np.isfinite(boll.volume_cm3)]
    known = [bolls[row] for row in measured]
    volumes = np.array([boll.volume_cm3 for boll in known])
    by_scale = 3 * scale.relative_error * volumes
    by_edges = volumes * [_shared(boll.diameter_cm, pixel_cm, filming) for boll in known]
    parted = (1 - PARTED_IN_SUM**2) * (parted_error(nearest[measured]) * volumes) ** 2
    own = np.array([boll.volume_error_cm3 for boll in known]) ** 2 - by_scale**2 - by_edges**2 - parted
    by_masks = BY_COLOUR_VOLUME * volumes.sum() if by_colour else 0.0
    return float(np.sqrt(by_scale.sum() ** 2 + by_edges.sum() ** 2 + np.maximum(own, 0.0).sum() + by_masks**2))


def _shared(diameter: float, pixel: float, filming: Filming) -> float:
    """Relative error that a volume has in common with the others of the plant, from edges that lie too far out all
    around and from sides that were not filmed. Both lengths in one unit."""
    by_edges = 6 * np.hypot(SHARED_EDGE_PX, SHARED_BLUR * filming.blur_px) * pixel / diameter
    return float(np.hypot(by_edges, UNSEEN * max(filming.gap_deg - SEEN_ALL_ROUND_DEG, 0.0) / 100))


def blurs_bolls(blur_px: float, pixel: float, diameters: NDArray) -> bool:
    """Whether the images are so blurred, relative to the width of the bolls, that the plant has a flag.

    Args:
        pixel, diameters: in one unit; NaN where a boll has none.
    """
    known = diameters[np.isfinite(diameters)]
    return len(known) > 0 and bool(blur_px * pixel > BLURRED_SHARE * np.median(known))


def count_error(
    confidences: NDArray,
    n_touching: int,
    halves: tuple[int, int] | None = None,
    by_colour: bool = False,
    n_unround: int = 0,
    filming: Filming = WELL_FILMED,
) -> float:
    """Standard error of the number of bolls, with each one's confidence as its probability; NaN without bolls, and for
    a plant that no image shows whole.

    Args:
        halves: counts by either half of the images. The mean squared difference of two counts with one variance is
            twice the variance; the count by all images is assumed to be no surer than that by half of them.
        by_colour: whether the masks are by colour alone.
        n_unround: number of bolls that are perhaps two, by `find_unround`; they are counted as one.
    """
    if not len(confidences) or not filming.whole:
        return np.nan
    by_halves = 0.5 * (halves[0] - halves[1]) ** 2 if halves else 0.0
    by_masks = (BY_COLOUR_MISCOUNTED * n_touching) ** 2 if by_colour else 0.0
    of_touching = MISCOUNTED * (n_touching - n_unround) + IS_TWO * n_unround
    behind = BEHIND * max(filming.gap_deg - 180, 0.0) / 100 * len(confidences)
    return float(np.sqrt((confidences * (1 - confidences)).sum() + of_touching + by_halves + by_masks + behind))


def halves_disagree(halves: tuple[int, int] | None) -> bool:
    """Whether the halves of the images count so differently that the plant has a flag."""
    return halves is not None and abs(halves[0] - halves[1]) > max(1.0, HALVES_DIFFER * max(halves))


def interval(value: float, error: float) -> tuple[float, float] | None:
    """Ends of the 95 % interval of a trait that is never negative; None where value or error is NaN."""
    if not np.isfinite(value + error):
        return None
    return float(np.maximum(value - COVERED * error, 0.0)), float(value + COVERED * error)


def count_interval(count: int, error: float) -> tuple[int, int] | None:
    """Ends of the 95 % interval of a count, to the nearest whole numbers; None without bolls.

    A count that is certain to a quarter of a boll is its own interval.
    """
    if not np.isfinite(error):
        return None
    either_side = int(np.floor(COVERED * error + 0.5))
    return max(count - either_side, 0), count + either_side
