# SPDX-License-Identifier: Apache-2.0
"""Images from a folder of photos."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from ..core.runs import Progress
from ..errors import BadInput, CaptureFailed
from ..io import images
from ..options import FramesOptions
from ..schemas.frames import FramesInfo
from . import frame_quality
from .frame_statistics import ORIENTATION_RULE, Keep, Picture, Taken, keep_all

MIN_PHOTOS: Final = 8


def take_photos(source: Path, options: FramesOptions, keep: Keep, progress: Progress) -> Taken:
    """Take photos at even steps of their order by name, all of one size.

    Raises:
        CaptureFailed: there are too few.
        BadInput: a photo cannot be decoded, or differs from the others in size.
    """
    found, unread = images.list_images(source), images.unread_photos(source)
    if len(found) < MIN_PHOTOS:
        few = f"{len(found)} photos in {source.name} ({MIN_PHOTOS} needed)"
        if unread:
            others = f"{len(unread)} of a format that is not read, e.g. {unread[0].name}"
            raise CaptureFailed(f"{few} and {others}; {images.how_to_convert(unread[0])}")
        raise CaptureFailed(f"{few}; take some 50 all around the plant")
    indices = frame_quality.spread_indices(len(found), options.count)
    focal_lengths_px: list[float | None] = []

    def pictures() -> Iterator[Picture]:
        shape: tuple[int, ...] = ()
        for index in indices:
            picture = images.read_image(found[index])
            if shape and picture.shape != shape:
                raise BadInput(
                    f"{found[index].name} is {picture.shape[1]} x {picture.shape[0]} px, those before are"
                    f" {shape[1]} x {shape[0]}; keep photos of one camera and orientation"
                )
            shape = picture.shape
            small = images.scale_down(picture, options.max_side)
            if not focal_lengths_px:
                focal_px = images.exif_focal_length_px(found[index])
                focal_lengths_px.append(focal_px and focal_px * max(small.shape) / max(shape))
            yield small

    entries, motions = keep_all(pictures(), indices, keep, progress)
    info = FramesInfo(
        source="images",
        ordered=False,
        orientation=ORIENTATION_RULE,
        focal_length_px=focal_lengths_px[0] or math.nan,
        images=tuple(replace(entry, file=found[entry.source_index].name) for entry in entries),
    )
    return Taken(info, motions, warnings=tuple(_warnings(found, unread, indices)))


def _warnings(found: Sequence[Path], unread: Sequence[Path], indices: Sequence[int]) -> Iterator[str]:
    """Warnings about the photos that were taken, and about those that were not."""
    if len(indices) < len(found):
        yield f"{len(indices)} of {len(found)} photos are used; raise frames.count to use more"
    if unread:
        yield (
            f"{len(unread)} photos are left out, e.g. {unread[0].name}, whose format is not read; "
            f"{images.how_to_convert(unread[0])}"
        )
    if images.has_transparency(first := found[indices[0]]):
        yield (
            f"photos have transparent parts, e.g. {first.name}; the colours that these hide are used, so save photos "
            "without transparency if they are not the plant's"
        )
