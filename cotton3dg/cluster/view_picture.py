"""The bolls by a single view beside the bolls by all views together (Cotton3DGaussians, Fig. 9)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import BollInstance, LiftedMasks
from ..core.scene import Camera, Gaussians
from ..gaussians.appearance import recolour_bolls
from ..gaussians.metrics import to_uint8
from ..gaussians.rasterizer import render
from ..geometry.camera_orbit import azimuths, fit_orbit
from .view_objects import find_objects

WIDTH_PX: Final = 640


def draw_views(
    gaussians: Gaussians, cameras: Sequence[Camera], lifted: LiftedMasks, bolls: Sequence[BollInstance]
) -> NDArray[np.uint8] | None:
    """(H, 2 W, 3) bolls as one view shows them, and as all views do, both seen from a quarter turn further on.

    The view is the one with the most masks. A boll has the same colour on both sides; None without masks.
    """
    objects = find_objects(lifted, gaussians.means.astype(np.float64))
    if not objects or len(cameras) < 2:
        return None
    chosen = int(np.bincount([item.view for item in objects]).argmax())
    merged = np.zeros(len(gaussians), np.int32)
    for boll in bolls:
        merged[boll.indices] = boll.boll_id
    single = np.zeros(len(gaussians), np.int32)
    for number, item in enumerate((item for item in objects if item.view == chosen), 1):
        known = np.bincount(merged[item.rows], minlength=1)
        known[0] = 0
        # A mask that did not become a boll has a colour that no boll has.
        single[item.rows] = known.argmax() if known.any() else len(bolls) + number
    names = [camera.name for camera in cameras]
    angles = azimuths(cameras, fit_orbit(cameras))
    away = (angles - angles[names.index(lifted.views[chosen])] - np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
    camera = cameras[int(np.abs(away).argmin())]
    small = camera.resized(WIDTH_PX, round(WIDTH_PX * camera.height / camera.width))
    sides = [to_uint8(render(recolour_bolls(gaussians, labels, 1.0), small).image) for labels in (single, merged)]
    return np.concatenate(sides, axis=1)
