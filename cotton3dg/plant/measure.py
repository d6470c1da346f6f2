"""The traits of a plant and of its bolls, from their Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.bolls import BollInstance
from ..core.measurements import BollTraits, PlantTraits, Scale
from ..core.scene import Float64, Gaussians
from .box import min_area_rectangle, oriented_box
from .hull import alpha_volume, calliper_diameter, convex_volume
from .isolate import Plant
from .outline import opaque_hull
from .surface import SAMPLES, surface_of_volume, surface_rows, visible_surface

TIP_OPACITY = 0.25
"""Opacity at which twigs end: thinner than a pixel, they are drawn fainter than what half covers one."""
TOP_RANK = 3
"""The plant is as high as the third highest of its Gaussians: one or two floaters are no top."""
ALPHA = 0.25
"""Radius of the ball that rolls over a boll, in diameters: it enters between boll and branch, not between locks."""


def measure_bolls(
    drawn: Gaussians, bolls: Sequence[BollInstance], scale: Scale | None, foot: Float64 | None
) -> list[BollTraits]:
    """Volume, diameter and place of each boll; without a scale or foot what needs them is NaN.

    Args:
        drawn: all Gaussians, as wide as they are drawn (`as_drawn`).

    Volume and diameter are those of the convex body that the boll's Gaussians show (`opaque_hull`). For the alpha
    volume the Gaussians' ellipsoids are blown up until their hull is that large.
    """
    traits = []
    for boll in bolls:
        cm = scale.cm_per_su if scale else np.nan
        own = drawn[boll.indices]
        own = own[surface_rows(own)]
        body = opaque_hull(own)
        volume, diameter = convex_volume(body), calliper_diameter(body)
        rolled = volume
        if not volume.reason:
            rolled = alpha_volume(surface_of_volume(own, volume.value), ALPHA * diameter.value)
        centre = np.full(3, np.nan)
        if scale and foot is not None:
            centre = (boll.centre - foot) @ scale.table_frame.T * cm
        traits.append(
            BollTraits(
                boll_id=boll.boll_id,
                centre_cm=centre,
                volume_cm3=volume.value * cm**3,
                alpha_volume_cm3=rolled.value * cm**3,
                diameter_cm=diameter.value * cm,
                n_gaussians=len(boll.indices),
                n_views=len(boll.views),
                confidence=boll.confidence,
                flags=(*boll.flags, *((volume.reason,) if volume.reason else ())),
            )
        )
    return traits


@dataclass(frozen=True)
class Silhouette:
    """Size of a plant, cm."""

    height_cm: float
    height_obb_cm: float
    length_cm: float
    width_cm: float


def measure_silhouette(drawn: Gaussians, plant: Plant, scale: Scale) -> Silhouette | None:
    """Height above the table and the least rectangle around the plant as seen from above.

    The oriented box stands around the plant and its foot, which the clamp hides; its height is the side that stands
    most upright (seed paper).

    Returns:
        None when nothing of the plant is opaque.
    """
    surface = visible_surface(drawn[plant.rows], TIP_OPACITY)
    if not len(surface):
        return None
    places = (surface - plant.foot) @ scale.table_frame.T * scale.cm_per_su
    box = oriented_box(np.vstack([places, np.zeros(3)]))
    upright = int(np.abs(box.axes[:, 2]).argmax())
    canopy = min_area_rectangle(places[:, :2])
    tops = np.sort(places[:, 2].reshape(-1, SAMPLES).max(axis=1))
    return Silhouette(float(tops[-TOP_RANK:][0]), float(box.sides[upright]), *map(float, canopy.sides))


def summarise_plant(bolls: Sequence[BollTraits], silhouette: Silhouette | None, has_scale: bool) -> PlantTraits:
    """The plant's row. No bolls have no volume, 0; bolls of unknown volume have none that is known, NaN."""
    flags = []
    volumes = np.array([boll.volume_cm3 for boll in bolls])
    known = volumes[np.isfinite(volumes)]
    if has_scale and len(known) < len(volumes):
        flags.append("bolls_without_volume")
    total = float(known.sum()) if has_scale and (len(known) or not len(volumes)) else np.nan
    size = silhouette or Silhouette(np.nan, np.nan, np.nan, np.nan)
    return PlantTraits(
        boll_count=len(bolls),
        boll_volume_cm3=total,
        boll_volume_mean_cm3=float(known.mean()) if len(known) else np.nan,
        plant_height_cm=size.height_cm,
        plant_height_obb_cm=size.height_obb_cm,
        canopy_size_cm=(size.length_cm + size.width_cm) / 2,
        canopy_length_cm=size.length_cm,
        canopy_width_cm=size.width_cm,
        flags=tuple(flags),
    )
