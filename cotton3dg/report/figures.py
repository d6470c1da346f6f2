# SPDX-License-Identifier: Apache-2.0
"""Pictures for the pages: photos with bolls outlined and numbered, cut-outs, renders; in data URIs."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.measurements import Scale
from ..core.scene import Camera, Float64, Gaussians
from ..gaussians import rasterizer
from ..gaussians.appearance import boll_colours
from ..gaussians.metrics import to_uint8
from ..geometry.camera_orbit import azimuths, evenly_spaced, fit_orbit
from ..io.images import scale_down

Picture = NDArray[np.uint8]
UNNAMED: Final = (255, 255, 255)
"""Colour of masks that did not become a boll."""
OUTLINE: Final = (255, 0, 200)
RULER: Final = (255, 230, 0)
CUT_MARGIN: Final = 0.35
"""Margin around a cut-out, in sizes of its mask."""


def jpeg_uri(rgb: Picture, max_side: int, quality: int = 72) -> str:
    """An image as the `src` of an <img>, its longer side at most `max_side` px."""
    import cv2

    bgr = cv2.cvtColor(scale_down(rgb, max_side), cv2.COLOR_RGB2BGR)
    _, content = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return "data:image/jpeg;base64," + base64.b64encode(content.tobytes()).decode("ascii")


def png_uri(path: Path) -> str:
    """A PNG file as the `src` of an <img>."""
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")


def colour_of(boll_id: int) -> tuple[int, int, int]:
    """RGB of a boll, as in cluster/bolls.ply."""
    red, green, blue = (boll_colours(np.array([boll_id]))[0] * 255).astype(int).tolist()
    return red, green, blue


def outline_masks(photo: Picture, ids: NDArray[np.uint16], owners: Mapping[int, int], thickness_px: int = 2) -> Picture:
    """The photo with each mask's outline in the colour of its boll, or white on black if it has no boll.

    Args:
        photo: (H, W, 3). ids: (H, W) mask ids. owners: mask id -> boll.
    """
    import cv2

    drawn = photo.copy()
    for mask_id in np.unique(ids[ids > 0]):
        contours, _ = cv2.findContours((ids == mask_id).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        boll = owners.get(int(mask_id))
        if boll is None:  # white on black is visible on any background
            cv2.drawContours(drawn, contours, -1, (0, 0, 0), thickness_px + 2, cv2.LINE_AA)
        cv2.drawContours(drawn, contours, -1, colour_of(boll) if boll else UNNAMED, thickness_px, cv2.LINE_AA)
    return drawn


def box_around(pixels: NDArray[Any], width: int, height: int) -> tuple[slice, slice]:
    """Rows and columns of a square around most of (N, 2) pixels, cut to the image; the whole image without pixels."""
    inside = pixels[np.isfinite(pixels).all(axis=1)]
    if not len(inside):
        return slice(0, height), slice(0, width)
    low, high = np.percentile(inside, [0.5, 99.5], axis=0)
    side = min(1.2 * max(float((high - low).max()), 0.25 * height), width, height)
    corner = np.clip((low + high) / 2 - side / 2, 0, np.maximum([width - side, height - side], 0))
    left, top, size = int(corner[0]), int(corner[1]), int(side)
    return slice(top, top + size), slice(left, left + size)


def number_bolls(
    photo: Picture, camera: Camera, centres: Mapping[int, Float64], seen: set[int], size_px: int, beside_px: float
) -> Picture:
    """The photo with the number of each boll to the right of it, or lower if another number stands there. Numbers of
    bolls without a mask in this view are grey.

    Args:
        centres: boll -> (3,) su. seen: bolls that have a mask in this view. size_px: width of the part that is shown.
        beside_px: how far from its boll a number stands.
    """
    import cv2

    drawn = photo.copy()
    size, pad = max(0.4, size_px / 1500), 2
    taken: list[tuple[int, int, int, int]] = []
    for boll, centre in centres.items():
        pixel = camera.project(np.asarray(centre)[None])[0][0]
        if not np.isfinite(pixel).all():
            continue
        text = str(boll)
        (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
        x, y = int(pixel[0] + beside_px), int(pixel[1]) + height // 2
        left, right, tall = x - pad, x + width + pad, height + 2 * pad
        for other_left, other_right, top, bottom in sorted(taken, key=lambda box: box[2]):
            if left <= other_right and right >= other_left and top <= y + pad <= bottom + tall:
                y = bottom + tall - pad + 1
        taken.append((left, right, y - height - pad, y + pad))
        fill = (20, 20, 20) if boll in seen else (110, 110, 110)
        cv2.rectangle(drawn, (left, y - height - pad), (right, y + pad), fill, -1)
        cv2.putText(drawn, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, size, (255, 255, 255), 1, cv2.LINE_AA)
    return drawn


def draw_ruler(photo: Picture, camera: Camera, scale: Scale, foot: Float64, height_cm: float) -> Picture:
    """The photo with the table's outline and a ruler that stands on it: a tick every 10 cm, a cross bar at the top.

    Args:
        foot: (3,) su, where the ruler stands. height_cm: of the plant.
    """
    import cv2

    drawn = photo.copy()
    width_px = max(1, round(photo.shape[1] / 640))

    def line(start: Float64, end: Float64, colour: tuple[int, int, int], thickness_px: int) -> None:
        pixels, depths = camera.project(np.stack([start, end]))
        if (depths > 0).all() and np.abs(pixels).max() < 1e5:
            (x0, y0), (x1, y1) = np.rint(pixels).astype(int).tolist()
            cv2.line(drawn, (x0, y0), (x1, y1), colour, thickness_px, cv2.LINE_AA)

    for corner, following in zip(scale.corners, np.roll(scale.corners, -1, axis=0), strict=True):
        line(corner, following, OUTLINE, width_px + 1)
    right = camera.rotation[0] / scale.cm_per_su
    up = scale.up / scale.cm_per_su
    for colour, thickness_px in (((0, 0, 0), width_px + 2), (RULER, width_px)):
        line(foot, foot + up * height_cm, colour, thickness_px)
        for tick_cm in np.arange(0.0, height_cm, 10.0):
            line(foot + up * tick_cm - right, foot + up * tick_cm + right, colour, thickness_px)
        line(foot + up * height_cm - 5 * right, foot + up * height_cm + 5 * right, colour, thickness_px)
    return drawn


def cut_out(photo: Picture, ids: NDArray[np.uint16], mask_id: int, side_px: int = 150) -> Picture | None:
    """A square of the photo around one mask with its outline; None when the mask is not there."""
    rows, columns = np.nonzero(ids == mask_id)
    if not len(rows):
        return None
    extent = max(int(np.ptp(rows)), int(np.ptp(columns))) + 1
    half = max(8, int(extent * (0.5 + CUT_MARGIN)))
    y, x = (int(rows.min()) + int(rows.max())) // 2, (int(columns.min()) + int(columns.max())) // 2
    top, left = max(0, y - half), max(0, x - half)
    part = photo[top : y + half, left : x + half]
    return scale_to(part, side_px)


def scale_to(rgb: Picture, side_px: int) -> Picture:
    """(H, W, 3) with its longer side `side_px`, whether it was longer or shorter before."""
    import cv2

    factor = side_px / max(rgb.shape[:2])
    scaled: Picture = cv2.resize(
        rgb, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    )
    return scaled


def choose_views(
    owners: Mapping[str, Mapping[int, int]], areas: Mapping[str, Mapping[int, int]], cameras: Sequence[Camera], n: int
) -> dict[int, list[tuple[str, int]]]:
    """Boll -> the (view, mask id) to show it by: from among those of the larger half, `n` spread around the plant."""
    angles = dict(zip([camera.name for camera in cameras], azimuths(cameras, fit_orbit(cameras)), strict=True))
    of_boll: dict[int, list[tuple[int, str, int]]] = {}
    for view, bolls in owners.items():
        for mask_id, boll in bolls.items():
            if view in angles:
                of_boll.setdefault(boll, []).append((areas.get(view, {}).get(mask_id, 0), view, mask_id))
    chosen = {}
    for boll, found in of_boll.items():
        larger = sorted(found, reverse=True)[: max(n, (len(found) + 1) // 2)]
        spread = evenly_spaced(np.array([angles[view] for _, view, _ in larger]), n)
        chosen[boll] = [larger[i][1:] for i in spread]
    return chosen


def render_photo(
    gaussians: Gaussians, camera: Camera, background: tuple[float, float, float] = rasterizer.BLACK
) -> Picture:
    """The model as a camera would see it."""
    return to_uint8(rasterizer.render(gaussians, camera, background=background).image)


def encode(array: NDArray[Any]) -> str:
    """The bytes of an array in base64, for typed arrays in the page."""
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
