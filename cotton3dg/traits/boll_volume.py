# SPDX-License-Identifier: Apache-2.0
"""Volume, width and place of each boll, from its Gaussians."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

import numpy as np

from ..core.bolls import BollInstance
from ..core.machine import on_all_cores
from ..core.measurements import OFF_PLANT, BollTraits, PlantFrame, Scale
from ..core.scene import Float64, Gaussians
from ..geometry.convex_measures import alpha_volume, calliper_diameter, convex_volume, projected_area
from .error_model import (
    AS_IF_NEAR,
    UNROUND_FLAG,
    USUAL_CONDITIONS,
    Conditions,
    boll_volume_error,
    find_unround,
    nearest_neighbours,
)
from .published import hull_of_means
from .silhouette_hull import opaque_hull
from .surface import sample_surface_of_volume, surface_rows

ALPHA: Final = 0.25
"""Radius of the ball that rolls over a boll, in diameters. It fits between boll and branch, but not between locks."""
NEAR_CLAMP: Final = 1.5
"""Height of a boll, in heights of the clamp, below which it may be the clamp's gleam."""
LIKELY_CM: Final = (2.5, 7.0)
"""Mean widths of open bolls, 3.5 to 6.5 cm, with a margin. Two touching bolls are wider, a lock or a label is
narrower."""


def measure_bolls(
    drawn: Gaussians,
    bolls: Sequence[BollInstance],
    scale: Scale | None,
    foot: Float64 | None,
    pixel_su: float = 0.0,
    clamp_cm: float = 0.0,
    apart: Collection[int] = (),
    conditions: Conditions = USUAL_CONDITIONS,
) -> list[BollTraits]:
    """Volume, diameter and place of each boll; traits that need a scale or a foot are NaN without it.

    Args:
        drawn: all Gaussians, as wide as they are drawn (`dilate_gaussians`).
        pixel_su: width of a pixel of the training images at the plant.
        clamp_cm: height of the clamp that holds the plant.
        apart: ids of bolls that do not hang on the plant.
        conditions: of the plant, for the errors.

    Volume and diameter are those of the convex body that the boll's Gaussians show (`opaque_hull`). For the alpha
    volume the Gaussians' ellipsoids are scaled until their hull has that volume.
    """
    cm = scale.cm_per_su if scale else np.nan
    surfaces = [drawn[boll.indices[surface_rows(drawn[boll.indices])]] for boll in bolls]
    bodies = on_all_cores(opaque_hull, surfaces)
    diameters = [calliper_diameter(body) for body in bodies]
    middles = np.array([boll.centre for boll in bolls]).reshape(-1, 3)
    volumes = [convex_volume(body) for body in bodies]
    widths = np.array([diameter.value for diameter in diameters])
    nearest = nearest_neighbours(middles, widths)
    unround = find_unround(nearest, np.array([volume.value for volume in volumes]) / (np.pi / 6 * widths**3))
    nearest[unround] = np.minimum(nearest[unround], AS_IF_NEAR)

    def measure_boll(number: int) -> BollTraits:
        boll, volume, diameter, body = bolls[number], volumes[number], diameters[number], bodies[number]
        rolled = volume
        if not volume.reason:
            rolled = alpha_volume(sample_surface_of_volume(surfaces[number], volume.value), ALPHA * diameter.value)
        centre = np.full(3, np.nan)
        if scale and foot is not None:
            centre = PlantFrame(scale, foot).cm(boll.centre)
        doubts = [*boll.flags, volume.reason or "", UNROUND_FLAG if unround[number] else ""]
        doubts += [OFF_PLANT] if boll.boll_id in apart else []
        doubts += ["near_clamp"] if centre[2] < NEAR_CLAMP * clamp_cm else []
        doubts += ["too_small"] if diameter.value * cm < LIKELY_CM[0] else []
        doubts += ["too_large"] if diameter.value * cm > LIKELY_CM[1] else []
        views, away = len(boll.views), nearest[number]
        error = boll_volume_error(diameter.value, volume.value, views, scale, pixel_su, away, conditions)
        return BollTraits(
            boll_id=boll.boll_id,
            centre_cm=centre,
            volume_cm3=volume.value * cm**3,
            alpha_volume_cm3=rolled.value * cm**3,
            diameter_cm=diameter.value * cm,
            n_gaussians=len(boll.indices),
            n_views=views,
            confidence=boll.confidence,
            flags=tuple(doubt for doubt in doubts if doubt),
            volume_error_cm3=volume.value * cm**3 * error,
            projected_area_cm2=projected_area(body).value * cm**2,
            volume_published_cm3=hull_of_means(drawn[boll.indices]).value * cm**3,
        )

    return on_all_cores(measure_boll, range(len(bolls)))
