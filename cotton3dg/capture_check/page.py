# SPDX-License-Identifier: Apache-2.0
"""check.html: the verdict, the walk from above, and photos with what was found, in one file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from .. import __version__
from ..geometry.camera_orbit import azimuths, evenly_spaced
from ..io.images import read_image
from ..report.figures import jpeg_uri, outline_masks
from ..report.frame import plant_frame
from ..report.page import fill_template
from ..report.walk import draw_walk
from ..schemas.check import CheckInfo
from ..schemas.frames import FramesInfo
from .first_count import find_sure
from .preview import Look

PHOTOS: Final = 4
PHOTO_SIDE_PX: Final = 640
STRIP: Final = 8
STRIP_SIDE_PX: Final = 240


def check_page(plant_id: str, info: CheckInfo, look: Look | None, frames: FramesInfo | None, strip: list[Any]) -> str:
    """The page as HTML.

    Args:
        look: None if the film was refused; then `strip` shows the film.
    """
    content: dict[str, Any] = {"plant_id": plant_id, "info": info, "walk": {}, "photos": [], "strip": strip}
    if look:
        frame = plant_frame(look.scale.info.scale, look.orbit, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))
        content["walk"] = draw_walk(look.frames.images, look.names, look.cameras, frame, look.scale.info.scale)
        content["photos"] = _photos(look)
    elif frames:
        content["walk"] = draw_walk(frames.images, (), (), None, None)
    return fill_template("check.html", [], {**content, "version": __version__})


def _photos(look: Look) -> list[dict[str, str]]:
    """Some photos from all sides with the counted bolls outlined, then those that show the scale."""
    counted = find_sure(look.bolls, len(look.sights))
    cameras = [sight.camera for sight in look.sights]
    times = {image.name: image.timestamp_s for image in look.frames.images}
    photos = []
    for number in evenly_spaced(azimuths(cameras, look.orbit), PHOTOS):
        sight = look.sights[number]
        name = sight.camera.name
        here = [own for boll in counted for shown_by, own in boll.seen if shown_by == number]
        ids = np.where(np.isin(sight.ids, here), sight.ids, np.uint16(0))
        drawn = outline_masks(read_image(look.images / name), ids, {})
        time_s = times.get(name)
        caption = f"{len(here)} of {len(counted)} bolls from here" + (
            f", at {time_s:.0f} s" if time_s is not None else ""
        )
        photos.append({"src": jpeg_uri(drawn, PHOTO_SIDE_PX), "caption": caption})
    references = look.scale.pictures.values()
    return photos + [{"src": jpeg_uri(picture, PHOTO_SIDE_PX), "caption": "the reference"} for picture in references]


def strip_of(frames: FramesInfo, folder: Path) -> list[dict[str, str]]:
    """Small images of the film."""
    images = frames.images[:: max(1, len(frames.images) // STRIP)][:STRIP]
    return [
        {
            "src": jpeg_uri(read_image(folder / image.name), STRIP_SIDE_PX),
            "caption": image.name if image.timestamp_s is None else f"{image.timestamp_s:.0f} s",
        }
        for image in images
    ]
