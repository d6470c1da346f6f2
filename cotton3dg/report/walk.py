# SPDX-License-Identifier: Apache-2.0
"""The walk around the plant seen from above, for the pages: 100 = the radius of the orbit, x to the right, y down."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, Final

import numpy as np

from ..core.measurements import Scale
from ..core.scene import Camera
from ..geometry.camera_orbit import fit_orbit
from ..schemas.frames import FrameInfo
from .frame import Frame

FARTHEST: Final = 138.0
"""Where the map draws cameras that stand farther away than it reaches."""


def draw_walk(
    images: Sequence[FrameInfo],
    looked_at: Collection[str],
    cameras: Sequence[Camera],
    frame: Frame | None,
    scale: Scale | None,
) -> dict[str, Any]:
    """Where each frame was taken, how blurred it is, and the table.

    Args:
        looked_at: names of the images that sfm tried to place.
        cameras: those of the placed images.
        frame: coordinates of the page; None = no map.
    """
    if not images:
        return {}
    blurs = {image.name: image.blur for image in images}
    dots: list[dict[str, Any]] = []
    table: list[list[float]] = []
    if frame is not None:
        orbit = fit_orbit(cameras)
        centre = frame.places(orbit.centre[None])[0, :2]
        radius = orbit.radius * float(np.linalg.norm(frame.page_from_scene[0]))
        places = (frame.places(np.stack([c.centre for c in cameras]))[:, :2] - centre) / radius * 100
        reach = max(130.0, 1.1 * float(np.percentile(np.abs(places), 98)))
        places = np.clip(places * 130 / reach, -FARTHEST, FARTHEST)
        for camera, (x, y) in zip(cameras, places, strict=True):
            blur = blurs.get(camera.name)
            dots.append({"x": x, "y": -y, "name": camera.name, "blur": blur, "shade": shade(blur)})
        if scale is not None:
            corners = (frame.places(scale.corners)[:, :2] - centre) / radius * 100 * 130 / reach
            table = (corners * [1, -1]).tolist()
    placed = {camera.name for camera in cameras}
    bars = [
        {
            "name": image.name,
            "time_s": image.timestamp_s,
            "blur": image.blur,
            "shade": shade(image.blur),
            "missed": bool(cameras) and image.name in looked_at and image.name not in placed,
        }
        for image in images
    ]
    return {"dots": dots, "table": table, "bars": bars}


def shade(blur: float | None) -> int:
    """0 (crisp) to 4 (blurred): the steps of colour on the map of the walk."""
    return int(np.searchsorted([0.25, 0.3, 0.35, 0.4], blur if blur is not None else 0.0))
