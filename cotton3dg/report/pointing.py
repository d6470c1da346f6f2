# SPDX-License-Identifier: Apache-2.0
"""Photos that can be pointed at: what the page needs to find the point in space that two clicks show."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ..core.scene import Camera
from ..geometry.camera_orbit import azimuths, evenly_spaced
from ..geometry.triangulation import FULL_WIDTH_PX, LEAST_ANGLE, SLIP_PX
from ..scale.corners import OFF_TABLE
from .figures import Picture, jpeg_uri
from .frame import Frame
from .pictures import Pictures

PHOTOS: Final = 12
"""30 degrees apart."""
FINENESS: Final = ((1280, 72), (1280, 60), (1280, 50), (1280, 40), (1080, 45), (900, 45), (760, 40))
"""Longer side of the photos, px, and quality of JPEG; the finest first."""
MOST_CHARACTERS: Final = 1_200_000
"""The photos are as fine as fits into so much of the page, which has 4 MB in all."""


def describe_photos(pictures: Pictures) -> dict[str, Any]:
    """Photos from around the plant with their cameras, bolls and table corners, all in the page's coordinates.

    Empty without cameras.
    """
    if len(pictures.cameras) < 2:
        return {}
    frame, scale = pictures.frame(), pictures.scale
    chosen = sorted(evenly_spaced(azimuths(pictures.cameras, pictures.orbit), PHOTOS))
    bolls = zip(pictures.bolls, frame.places(np.array([b.centre for b in pictures.bolls]).reshape(-1, 3)), strict=True)
    corners = frame.places(scale.corners) if scale is not None else np.zeros((0, 3))
    sources = _encode([pictures.photo(pictures.cameras[i].name) for i in chosen])
    cameras = [_describe(pictures, pictures.cameras[i], frame) for i in chosen]
    return {
        "unit": frame.unit,
        "photos": [camera | {"src": source} for camera, source in zip(cameras, sources, strict=True)],
        "bolls": [[boll.boll_id, *np.round(place, 3).tolist()] for boll, place in bolls],
        "corners": np.round(corners, 4).tolist(),
        "relative_error": scale.relative_error if scale is not None else 0.0,
        "slip_px": SLIP_PX,
        "full_width_px": FULL_WIDTH_PX,
        "least_angle": LEAST_ANGLE,
        "off_table": OFF_TABLE,
    }


def _encode(photos: list[Picture]) -> list[str]:
    """Photos as data URIs, as good as the page has room for."""
    for side_px, quality in FINENESS:
        sources = [jpeg_uri(photo, side_px, quality) for photo in photos]
        if sum(map(len, sources)) <= MOST_CHARACTERS:
            break
    return sources


def _describe(pictures: Pictures, camera: Camera, frame: Frame) -> dict[str, Any]:
    """A photo, `pose` (page to camera) to project with, and `centre` and `rays` (camera to page) to look along."""
    scene_from_page = np.linalg.inv(frame.page_from_scene)
    pose = np.column_stack(
        [
            camera.rotation @ scene_from_page,
            camera.cam_from_scene[:, 3] - camera.rotation @ scene_from_page @ frame.offset,
        ]
    )
    path = pictures.workspace.undistorted_image(camera.name)
    return {
        "name": camera.name,
        "sha256": next(iter(pictures.workspace.hashes(path).values())),
        "size": [camera.width, camera.height],
        "focal": [camera.fx, camera.fy],
        "middle": [camera.cx, camera.cy],
        "pose": pose.tolist(),
        "centre": frame.places(camera.centre[None])[0].tolist(),
        "rays": (frame.page_from_scene @ camera.rotation.T).tolist(),
    }
