# SPDX-License-Identifier: Apache-2.0
"""The printed card of a plant, drawn: markers for scale and place, a code, grey patches, text and a ruler."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.card import (
    CODE_CM,
    HEIGHT_CM,
    MARKER_CM,
    MARKER_DICTIONARY,
    MARKERS_CM,
    PATCH_LEVELS,
    PATCHES_CM,
    RULER_CM,
    WIDTH_CM,
)
from ..geometry.printed_markers import marker_dictionary
from .fonts import font

Picture = NDArray[np.uint8]


def draw_card(
    code: Picture | None, title: str, lines: Sequence[str], paper_cm: tuple[float, float], dots: int
) -> Picture:
    """(H, W) sheet of paper with a card.

    Args:
        code: (N, N) the card's code, one pixel per module; None for a card without one.
        title: the plant's id. lines: further text; lines that do not fit are left out.
        paper_cm: width and height. dots: per cm.
    """
    import cv2

    sheet = np.full((round(paper_cm[1] * dots), round(paper_cm[0] * dots)), 255, np.uint8)
    left, top = (paper_cm[0] - WIDTH_CM) / 2, (paper_cm[1] - HEIGHT_CM) / 2

    def place(x_cm: float, y_cm: float, picture: Picture) -> None:
        x, y = round((left + x_cm) * dots), round((top + y_cm) * dots)
        sheet[y : y + len(picture), x : x + picture.shape[1]] = picture

    side = round(MARKER_CM * dots)
    for number, (x, y) in MARKERS_CM.items():
        place(x, y, cv2.aruco.generateImageMarker(marker_dictionary(MARKER_DICTIONARY), number, side))
    if code is not None:
        size = round(CODE_CM[2] * dots)
        place(*CODE_CM[:2], cv2.resize(code, (size, size), interpolation=cv2.INTER_NEAREST))
    columns, y, width, height = PATCHES_CM
    for x, levels in zip(columns, (PATCH_LEVELS, PATCH_LEVELS[::-1]), strict=True):
        for row, level in enumerate(levels):
            patch = np.full((round(height * dots), round(width * dots)), level, np.uint8)
            patch[[0, -1]] = patch[:, [0, -1]] = 0
            place(x, y + row * height, patch)
    _write(sheet, title, lines, (left, top), dots)
    _draw_ruler(sheet, left + (WIDTH_CM - RULER_CM) / 2, top + HEIGHT_CM - 0.15, dots)
    return sheet


def _write(sheet: Picture, title: str, lines: Sequence[str], origin: tuple[float, float], dots: int) -> None:
    """The id between the upper markers, the lines below the code, room for date and notes between the lower markers."""
    from PIL import Image, ImageDraw

    page = Image.fromarray(sheet)
    draw = ImageDraw.Draw(page)

    def text(words: str, x: float, y: float, width: float, size: float, least: float) -> None:
        for points in np.arange(size, least - 0.01, -0.05):
            shown = font(words, max(4, round(points * dots)))
            if draw.textlength(words, shown) <= width * dots:
                break
        else:
            while len(words) > 1 and draw.textlength(words + "…", shown) > width * dots:
                words = words[:-1]
            words += "…"
        draw.text(((origin[0] + x) * dots, (origin[1] + y) * dots), words, 0, shown, anchor="lm")

    middle, between = MARKER_CM + 0.5, 13.8 - MARKER_CM - 1.0
    half = len(title) // 2 if len(title) > 16 else len(title)
    for part, y in zip((title[:half], title[half:]), (1.6, 3.2), strict=True):
        text(part, middle, y, between, 1.5, 0.4)
    for number, line in enumerate(lines[:6]):
        text(line, 9.5 * (number % 2), 17.0 + 0.75 * (number // 2), 9.0, 0.5, 0.3)
    for words, y in (("Date", 20.6), ("Notes", 21.9)):
        text(words, middle, y, between, 0.4, 0.3)
    for y in (20.9, 22.2, 23.4, 24.6):
        start = middle + (1.3 if y < 23 else 0.0)
        row, x = round((origin[1] + y) * dots), round((origin[0] + start) * dots)
        draw.line((x, row, round((origin[0] + middle + between) * dots), row), fill=0, width=max(1, dots // 50))
    text("cotton3dg card: lay flat, all of it in view; ruler 10 cm", 0.0, 19.5, WIDTH_CM, 0.32, 0.2)
    sheet[:] = np.asarray(page)


def _draw_ruler(sheet: Picture, left_cm: float, line_cm: float, dots: int) -> None:
    """A line with a mark each cm; the outer edges of the first and the last are `RULER_CM` apart."""
    thick = max(1, dots // 25)
    left, line = round(left_cm * dots), round(line_cm * dots)
    sheet[line : line + thick, left : left + round(RULER_CM * dots)] = 0
    for mark in range(round(RULER_CM) + 1):
        x = left + mark * dots - (thick if mark == round(RULER_CM) else 0)
        tick = round((0.45 if mark % 5 == 0 else 0.25) * dots)
        sheet[line - tick : line, x : x + thick] = 0
