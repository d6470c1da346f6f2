"""Measured against true values as a PNG: points, the 1:1 line and the figures beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .images import write_image

SIZE = 720
LEFT, RIGHT, TOP, BOTTOM = 110, 30, 60, 90
INK, GREY, LIGHT, DOT = (30, 30, 30), (120, 120, 120), (225, 225, 225), (30, 100, 180)


def write_scatter(path: Path, title: str, true: NDArray, measured: NDArray, notes: list[str]) -> None:
    """Save the plot.

    Args:
        title: ASCII, with the unit. true, measured: (N,) finite, N > 0. notes: lines for the corner.
    """
    write_image(path, scatter(title, true, measured, notes))


def scatter(title: str, true: NDArray, measured: NDArray, notes: list[str]) -> NDArray[np.uint8]:
    """(H, W, 3) uint8; both axes have the same scale, so that the 1:1 line is a diagonal."""
    import cv2

    canvas = np.full((SIZE, SIZE, 3), 255, np.uint8)
    low, high, step = ticks(float(min(true.min(), measured.min())), float(max(true.max(), measured.max())))
    side = min(SIZE - LEFT - RIGHT, SIZE - TOP - BOTTOM)

    def place(x: float, y: float) -> tuple[int, int]:
        return LEFT + round((x - low) / (high - low) * side), TOP + side - round((y - low) / (high - low) * side)

    def text(words: str, at: tuple[int, int], size: float = 0.5, colour: tuple[int, int, int] = INK) -> None:
        cv2.putText(canvas, words, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)

    def width(words: str, size: float = 0.5) -> int:
        return cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0][0]

    for value in np.arange(low, high + step / 2, step):
        cv2.line(canvas, place(value, low), place(value, high), LIGHT, 1)
        cv2.line(canvas, place(low, value), place(high, value), LIGHT, 1)
        label = f"{value:.6g}"
        x, y = place(value, low)
        text(label, (x - width(label) // 2, y + 22))
        x, y = place(low, value)
        text(label, (x - width(label) - 8, y + 5))
    cv2.rectangle(canvas, place(low, high), place(high, low), GREY, 1)
    cv2.line(canvas, place(low, low), place(high, high), GREY, 1, cv2.LINE_AA)
    for x, y in zip(true, measured, strict=True):
        cv2.circle(canvas, place(float(x), float(y)), 5, DOT, -1, cv2.LINE_AA)
    text(title, (LEFT, 36), 0.7)
    text("true", (LEFT + (side - width("true", 0.6)) // 2, TOP + side + 58), 0.6)
    text("measured", (14, TOP - 14), 0.6)
    for line, words in enumerate(notes):
        text(words, (LEFT + 14, TOP + 26 + 22 * line))
    return canvas


def ticks(low: float, high: float) -> tuple[float, float, float]:
    """Round limits around two values, and a round step between 4 to 10 marks."""
    span = high - low or abs(high) or 1.0
    low, high = low - 0.05 * span, high + 0.05 * span
    raw = (high - low) / 6
    power = 10.0 ** np.floor(np.log10(raw))
    step = float(power * min((1, 2, 5, 10), key=lambda factor: abs(np.log(factor * power / raw))))
    return float(np.floor(low / step) * step), float(np.ceil(high / step) * step), step
