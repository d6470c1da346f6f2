# SPDX-License-Identifier: Apache-2.0
"""The bolls by a single view beside the bolls by all views together (Cotton3DGaussians, Fig. 9)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Gaussians
from ..gaussians.appearance import recolour_bolls
from ..gaussians.metrics import to_uint8
from ..gaussians.rasterizer import accumulate_weights, render
from ..geometry.camera_orbit import azimuths, fit_orbit

WIDTH_PX: Final = 640


def draw_views(
    gaussians: Gaussians, cameras: Sequence[Camera], view: Camera, ids: NDArray[np.uint16], labels: NDArray[np.int32]
) -> NDArray[np.uint8]:
    """(H, 2 W, 3) the bolls by one view and by all views, both seen from a quarter turn further on.

    A boll has the same colour on both sides.

    Args:
        view: one of the cameras; at least two of them have a pose.
        ids: (H, W) masks of its image.
        labels: (N,) boll of each Gaussian by all views, 0 = none.
    """
    held = label_view(gaussians, view, ids)
    single = np.zeros(len(gaussians), np.int32)
    for number, mask_id in enumerate(np.unique(held[held > 0]), 1):
        rows = held == mask_id
        known = np.bincount(labels[rows], minlength=1)
        known[0] = 0
        # A mask that did not become a boll has a colour that no boll has.
        single[rows] = known.argmax() if known.any() else labels.max() + number
    angles = azimuths(cameras, fit_orbit(cameras))
    names = [camera.name for camera in cameras]
    away = (angles - angles[names.index(view.name)] - np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
    camera = cameras[int(np.abs(away).argmin())]
    small = camera.resized(WIDTH_PX, round(WIDTH_PX * camera.height / camera.width))
    sides = [to_uint8(render(recolour_bolls(gaussians, own, 1.0), small).image) for own in (single, labels)]
    return np.concatenate(sides, axis=1)


def label_view(gaussians: Gaussians, camera: Camera, ids: NDArray[np.uint16]) -> NDArray[np.int64]:
    """(N,) the mask of one view that has half of the weight of a Gaussian, 0 = none.

    Args:
        ids: (H, W) masks of the view.
    """
    weights = accumulate_weights(gaussians, camera, ids)
    labels = np.zeros(len(gaussians), np.int64)
    most = (weights.ids > 0) & (weights.weights > 0.5 * weights.total[weights.rows])
    labels[weights.rows[most]] = weights.ids[most]
    return labels
