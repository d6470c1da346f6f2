# SPDX-License-Identifier: Apache-2.0
"""Height and canopy of a plant, with flags where the end of a twig may be lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import nan
from typing import Final

import numpy as np

from ..core.measurements import PlantFrame, Scale
from ..core.scene import Float64, Gaussians
from ..geometry.boxes import min_area_rectangle, nearly_least_rectangles, oriented_box
from ..geometry.convex_measures import convex_volume
from ..geometry.polylines import resampled
from .plant_segmentation import Plant, find_lost_tips
from .published import NO_PUBLISHED_SIZE, PublishedSize, box_of_means
from .surface import SAMPLES, sample_visible_surface

TIP_OPACITY: Final = 0.2
"""Opacity at which twigs end. A twig thinner than a pixel is drawn fainter than a thing that half covers the pixel.
With this value heights and canopies of 58 rendered plants are right on average; docs/notes/stated_errors.md."""
FAINT_OPACITY: Final = 0.1
"""Fainter Gaussians are haze as a rule. Yet they may be the end of a twig of half a pixel: the plant has a flag ..."""
FAINT_SHARE: Final = 0.02
"""... if it is larger by more than this share where it ends at this opacity."""
TOP_RANK: Final = 2
"""Rank of the Gaussian whose height is the plant's: the second highest, because the highest may be a floater."""
LOST_SHARE: Final = 0.01
"""The plant has a flag if twigs that the model lacks make its height or canopy larger by more than this share."""
END_CM: Final = 1.0
"""Standard error of the end of a twig that only the photos show (plant_map/thin_twigs.py)."""
END_SPACING_CM: Final = 0.25
TURNED_AREA: Final = 0.01
"""Two rectangles around the plant may both be the least one if their areas differ by at most this share. ..."""
TURNED_CANOPY: Final = 0.01
"""... The canopy is then doubtful if theirs differ by more than this share: one may be long, the other square."""


@dataclass(frozen=True)
class PlantSize:
    """Size of a plant, cm and cm³."""

    height_cm: float = nan
    height_obb_cm: float = nan
    length_cm: float = nan
    width_cm: float = nan
    hull_volume_cm3: float = nan
    turned_canopy_cm: float = nan
    """The canopy that differs most from `canopy_cm`, among rectangles about as small; `canopy_cm` without any."""
    published: PublishedSize = NO_PUBLISHED_SIZE

    @property
    def canopy_cm(self) -> float:
        return (self.length_cm + self.width_cm) / 2

    def exceeds(self, other: PlantSize, share: float) -> bool:
        """Whether the plant is higher, or its canopy larger, by more than a share."""
        return max(self.height_cm / other.height_cm, self.canopy_cm / other.canopy_cm) > 1 + share


@dataclass(frozen=True)
class Sized:
    """A plant's size, with the doubts about it."""

    size: PlantSize | None = None
    """None if no part of the plant is opaque."""
    other: PlantSize | None = None
    """Another possible size; the difference counts as an error."""
    concerns: dict[str, str] = field(default_factory=dict)
    """Flag -> its reason."""


def size_plant(
    drawn: Gaussians, plant: Plant, scale: Scale, clamp_cm: float, thin_ends: Sequence[Float64] = ()
) -> Sized:
    """The size of a plant, up to the ends of its twigs as far as model and photos show them.

    Args:
        drawn: all Gaussians, as wide as they are drawn (`dilate_gaussians`).
        clamp_cm: height of the clamp that holds the plant.
        thin_ends: (K, 3) su each, places of twigs that the photos show and the model lacks.
    """
    modelled = measure_silhouette(drawn, plant, scale)
    if modelled is None:
        return Sized()
    size, other, concerns = modelled, None, {}
    if thin_ends:
        size, other = (_with_ends(drawn, plant, scale, thin_ends, cut_cm) or modelled for cut_cm in (0.0, END_CM))
        if size.exceeds(modelled, LOST_SHARE):
            concerns["thin_ends"] = (
                f"the model lacks ends of twigs that the photos show ({len(thin_ends)} followed); by the model alone"
                f" the plant would be {modelled.height_cm:.1f} cm high, its canopy {modelled.canopy_cm:.1f} cm"
            )
    if perhaps := _with_lost_tips(drawn, plant, scale, clamp_cm, size):
        other = perhaps
        concerns["lost_tips"] = (
            "the end of a twig may be lost: with faint pieces, or specks in the air beside it, the plant would be"
            f" {perhaps.height_cm:.1f} cm high, its canopy {perhaps.canopy_cm:.1f} cm; film closer, in better light"
        )
    return Sized(size, other, concerns)


def measure_silhouette(
    drawn: Gaussians, plant: Plant, scale: Scale, opaque: float = TIP_OPACITY, beyond: Float64 | None = None
) -> PlantSize | None:
    """Height above the table and the least rectangle around the plant as seen from above.

    The oriented box stands around the plant and its foot, which the clamp hides; its height is the side that stands
    most upright.

    Args:
        opaque: opacity at which the plant ends.
        beyond: (P, 3) su, places on twigs that the model lacks.
    Returns:
        None if no part of the plant is opaque.
    """
    surface = sample_visible_surface(drawn[plant.rows], opaque)
    if not len(surface):
        return None
    frame = PlantFrame(scale, plant.foot)
    places, further = frame.cm(surface), frame.cm(np.zeros((0, 3)) if beyond is None else beyond)
    tops = np.append(places[:, 2].reshape(-1, SAMPLES).max(axis=1), further[:, 2])
    unsure_cm = END_CM if len(further) else 0.0
    return measure_places(np.vstack([places, further]), tops, frame.cm(drawn.means[plant.rows]), unsure_cm)


def measure_places(places: Float64, tops: Float64, middles: Float64, unsure_cm: float = 0.0) -> PlantSize:
    """Size of a plant whose surface is given in the plant frame.

    Args:
        places: (N, 3) cm, z above the table top, from the foot of the stem. tops: (M,) cm, heights of its bodies.
        middles: (M, 3) cm, places of these.
        unsure_cm: how far the end of a twig may lie from its place.
    """
    box = oriented_box(np.vstack([places, np.zeros(3)]))
    upright = int(np.abs(box.axes[:, 2]).argmax())
    length_cm, width_cm = map(float, min_area_rectangle(places[:, :2]).sides)
    height = float(np.sort(tops)[-TOP_RANK:][0])
    hull = convex_volume(np.vstack([places, np.zeros(3)])).value
    # A line of points from a scanner does not have a width.
    area = max(TURNED_AREA, unsure_cm / width_cm) if width_cm else TURNED_AREA
    turned_cm = _turned_canopy_cm(places[:, :2], (length_cm + width_cm) / 2, area)
    published = box_of_means(middles)
    return PlantSize(height, float(box.sides[upright]), length_cm, width_cm, hull, turned_cm, published)


def _turned_canopy_cm(places: Float64, canopy_cm: float, area: float) -> float:
    """`PlantSize.turned_canopy_cm` of (N, 2) places; a rectangle with this share more area may also be the least."""
    canopies_cm = nearly_least_rectangles(places, area).mean(axis=1)
    turned_cm = float(canopies_cm[np.argmax(np.abs(canopies_cm - canopy_cm))])
    return turned_cm if abs(turned_cm - canopy_cm) > TURNED_CANOPY * canopy_cm else canopy_cm


def _with_ends(
    drawn: Gaussians, plant: Plant, scale: Scale, thin_ends: Sequence[Float64], cut_cm: float
) -> PlantSize | None:
    """The size with the twigs that the model lacks, without the last `cut_cm` of each."""
    spacing = END_SPACING_CM / scale.cm_per_su
    cut = round(cut_cm / END_SPACING_CM)
    places = [along[: len(along) - cut] for along in (resampled(end, spacing) for end in thin_ends)]
    return measure_silhouette(drawn, plant, scale, TIP_OPACITY, np.vstack(places))


def _with_lost_tips(
    drawn: Gaussians, plant: Plant, scale: Scale, clamp_cm: float, silhouette: PlantSize
) -> PlantSize | None:
    """The size with specks beside the plant, else with its faint parts; None if neither makes a difference."""
    tips = find_lost_tips(drawn, plant, scale, clamp_cm)
    for rows, opaque, share in ((plant.rows | tips, TIP_OPACITY, LOST_SHARE), (plant.rows, FAINT_OPACITY, FAINT_SHARE)):
        size = measure_silhouette(drawn, replace(plant, rows=rows), scale, opaque)
        if size and size.exceeds(silhouette, share):
            return size
    return None
