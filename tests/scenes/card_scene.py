# SPDX-License-Identifier: Apache-2.0
"""Photos and films of a printed card that lies in front of grey clutter, by homographies, in linear light."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from cotton3dg.core.card import CODE_CM
from cotton3dg.identity.codes import code_picture
from cotton3dg.identity.draw_card import draw_card
from cotton3dg.identity.names import card_text
from cotton3dg.io.encode import video_encoder

DOTS = 40
PAPER_CM = (21.0, 29.7)


def card_sheet(plant_id: str, dots: int = DOTS) -> NDArray[np.uint8]:
    """The sheet as `cotton3dg cards` prints it."""
    return draw_card(code_picture(card_text(plant_id)), plant_id, [], PAPER_CM, dots)


def card_photo(
    sheet: NDArray[np.uint8],
    code_px: float,
    *,
    tilt_deg: float = 0.0,
    turn_deg: float = 0.0,
    size: tuple[int, int] = (0, 0),
    middle: tuple[float, float] | None = None,
    blur_px: float = 0.0,
    motion_px: float = 0.0,
    noise: float = 0.0,
    light: tuple[float, float] = (1.0, 1.0),
    dirt: float = 0.0,
    hidden: float = 0.0,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """(H, W) grey photo of a card whose code would be `code_px` wide if it were seen from straight above.

    Args:
        tilt_deg: between the card's normal and the camera. turn_deg: within the card's plane.
        size: width and height of the photo; 0 = a little more than the card.
        middle: where the card's middle is, px.
        blur_px: sigma of the focus. motion_px: length of a smear in a direction of chance. noise: sigma, grey levels.
        light: at the left and at the right edge.
        dirt: share of the card under splashes. hidden: share of its code that something covers from one side.
    """
    rng = np.random.default_rng(seed)
    dots = sheet.shape[1] / PAPER_CM[0]
    scale = code_px / CODE_CM[2] / dots
    # Drawn at the resolution of the photo, or twice that: a warp takes single pixels and does not average.
    shrunk = min(1.0, 2 * scale)
    paper = (0.04 + 0.82 * (sheet / np.float32(255)) ** 2.2).astype(np.float32)
    _soil(paper, dots, dirt, hidden, rng)
    paper = cv2.resize(paper, None, fx=shrunk, fy=shrunk, interpolation=cv2.INTER_AREA)
    scale /= shrunk
    h, w = paper.shape
    if not size[0]:
        size = (int(w * scale * 1.5) + 16, int(h * scale * 1.5) + 16)
    corners = np.array([(-w / 2, -h / 2), (w / 2, -h / 2), (w / 2, h / 2), (-w / 2, h / 2)]) * scale
    turn, tilt = np.radians(turn_deg), np.radians(tilt_deg)
    flat = corners @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    # A camera whose focal length is 0.8 widths of a photo in which the card is a fifth: eight cards away.
    away = 8.0 * h * scale
    depth = away - flat[:, 1] * np.sin(tilt)
    seen = np.stack([flat[:, 0], flat[:, 1] * np.cos(tilt)], 1) * (away / depth)[:, None]
    place = np.array(middle if middle else (size[0] / 2, size[1] / 2))
    n = 2
    source = np.array([(0, 0), (w, 0), (w, h), (0, h)], np.float32) - 0.5
    warp = cv2.getPerspectiveTransform(source, (n * (seen + place) - 0.5).astype(np.float32))
    ground = cv2.resize(rng.uniform(0.05, 0.5, (size[1] // 16 + 2, size[0] // 16 + 2)).astype(np.float32),
                        (n * size[0], n * size[1]), interpolation=cv2.INTER_CUBIC)  # fmt: skip
    cv2.warpPerspective(
        paper, warp, (n * size[0], n * size[1]), ground, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT
    )
    photo = cv2.resize(ground, size, interpolation=cv2.INTER_AREA)
    if blur_px:
        photo = cv2.GaussianBlur(photo, (0, 0), blur_px)
    if motion_px > 1:
        photo = cv2.filter2D(photo, -1, _smear(motion_px, rng.uniform(0, np.pi)))
    photo = photo * np.linspace(*light, size[0], dtype=np.float32)
    grey = 255 * np.clip(photo, 0, 1) ** (1 / 2.2) + noise * rng.standard_normal(photo.shape, np.float32)
    return np.clip(grey + 0.5, 0, 255).astype(np.uint8)


def _soil(paper: NDArray, dots: float, dirt: float, hidden: float, rng: np.random.Generator) -> None:
    """Splashes of earth, and a leaf or a hand over a side of the code, in place."""
    height, width = paper.shape
    covered = 0.0
    while covered < dirt * paper.size:
        radius = float(rng.uniform(0.1, 0.9)) * dots
        place = (int(rng.uniform(0, width)), int(rng.uniform(0, height)))
        cv2.circle(paper, place, max(1, int(radius)), float(rng.uniform(0.05, 0.3)), -1)
        covered += np.pi * radius**2
    if hidden:
        left = (width - 18.6 * dots) / 2 + CODE_CM[0] * dots
        right = left + hidden * CODE_CM[2] * dots
        paper[:, int(left) : int(right)] = rng.uniform(0.1, 0.4)


def _smear(length: float, angle: float) -> NDArray[np.float32]:
    size = 2 * int(length / 2 + 1) + 1
    kernel = np.zeros((size, size), np.float32)
    arm = np.array([np.cos(angle), np.sin(angle)]) * length / 2
    a, b = np.array([size // 2] * 2) - arm, np.array([size // 2] * 2) + arm
    cv2.line(kernel, tuple(np.round(a).astype(int).tolist()), tuple(np.round(b).astype(int).tolist()), 1.0)
    return kernel / kernel.sum()


def film_card(
    file: Path,
    sheet: NDArray[np.uint8] | None,
    *,
    n_frames: int = 24,
    fps: float = 8.0,
    size: tuple[int, int] = (960, 540),
    code_px: float = 110.0,
    seed: int = 0,
    **how: float,
) -> Path:
    """A video in which a card lies on something and the camera passes by; None = no card."""
    rng = np.random.default_rng(seed)
    with video_encoder(file, *size, fps, 20) as write:
        for number in range(n_frames):
            at = number / max(1, n_frames - 1)
            settings = {"tilt_deg": 45.0 + 10 * np.sin(5 * at), "turn_deg": 50 * at, "noise": 3.0, "blur_px": 0.5}
            settings |= how
            middle = (size[0] * (0.4 + 0.2 * at), size[1] * 0.55 + rng.normal(0, 3))
            blank = np.full((1188, 840), 100, np.uint8)
            grey = card_photo(
                blank if sheet is None else sheet, code_px, size=size, middle=middle, seed=seed, **settings
            )
            write(np.repeat(grey[..., None], 3, axis=2))
    return file
