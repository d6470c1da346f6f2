"""Accuracy against time as a picture: a dot a setting, a colour a sweep, and the front of settings worth choosing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .images import write_image
from .scatter import GREY, INK, LIGHT, ticks

WIDTH, HEIGHT = 1500, 660
PANEL_WIDTH, PANEL_HEIGHT = 600, 490
PANEL_LEFT, PANEL_TOP = (90, 820), 70
COLOURS = (
    (30, 100, 180),
    (215, 95, 20),
    (40, 140, 60),
    (190, 40, 60),
    (130, 80, 180),
    (120, 80, 60),
    (220, 120, 190),
    (90, 90, 90),
    (160, 160, 20),
    (20, 170, 190),
    (10, 10, 10),
)
ROUND_SECONDS = tuple(mantissa * 10**power for power in range(-1, 6) for mantissa in (1, 2, 3, 4, 5, 7))


@dataclass(frozen=True)
class Dot:
    """One setting."""

    series: str
    label: str
    seconds: float
    value: float
    on_front: bool


@dataclass(frozen=True)
class Panel:
    """One measure of accuracy."""

    title: str
    dots: Sequence[Dot]


def write_tradeoff(path: Path, panels: Sequence[Panel], time_axis: str) -> None:
    """Save one or two panels side by side; texts are ASCII, values finite and seconds above 0."""
    write_image(path, tradeoff(panels, time_axis))


def tradeoff(panels: Sequence[Panel], time_axis: str) -> NDArray[np.uint8]:
    """(HEIGHT, WIDTH, 3) uint8."""
    canvas = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    series = list(dict.fromkeys(dot.series for panel in panels for dot in panel.dots))
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(series)}
    for panel, left in zip(panels, PANEL_LEFT, strict=False):
        if panel.dots:
            _draw(canvas, left, panel, colours, time_axis)
    x = PANEL_LEFT[0]
    for name in series:
        _disc(canvas, (x + 6, HEIGHT - 18), 6, colours[name])
        _text(canvas, name, (x + 20, HEIGHT - 12), 0.5)
        x += 36 + _width(name, 0.5)
    return canvas


def _draw(canvas: NDArray, left: int, panel: Panel, colours: dict[str, tuple[int, int, int]], time_axis: str) -> None:
    import cv2

    values = [dot.value for dot in panel.dots]
    low, high, step = ticks(min(values), max(values))
    logs = [math.log10(dot.seconds) for dot in panel.dots]
    begin, end = min(logs) - 0.08, max(logs) + 0.12

    def place(seconds: float, value: float) -> tuple[int, int]:
        x = (math.log10(seconds) - begin) / (end - begin)
        return left + round(x * PANEL_WIDTH), PANEL_TOP + round((high - value) / (high - low) * PANEL_HEIGHT)

    for value in np.arange(low, high + step / 2, step):
        y = place(10**begin, value)[1]
        cv2.line(canvas, (left, y), (left + PANEL_WIDTH, y), LIGHT, 1)
        label = f"{value:.6g}"
        _text(canvas, label, (left - _width(label, 0.5) - 8, y + 5), 0.5)
    for seconds in ROUND_SECONDS:
        if begin <= math.log10(seconds) <= end:
            x = place(seconds, low)[0]
            cv2.line(canvas, (x, PANEL_TOP), (x, PANEL_TOP + PANEL_HEIGHT), LIGHT, 1)
            label = f"{seconds:g}"
            _text(canvas, label, (x - _width(label, 0.5) // 2, PANEL_TOP + PANEL_HEIGHT + 20), 0.5)
    cv2.rectangle(canvas, (left, PANEL_TOP), (left + PANEL_WIDTH, PANEL_TOP + PANEL_HEIGHT), GREY, 1)
    front = sorted((dot for dot in panel.dots if dot.on_front), key=lambda dot: dot.seconds)
    corners = [place(dot.seconds, dot.value) for dot in front]
    for first, second in pairwise(corners):
        cv2.line(canvas, first, (second[0], first[1]), INK, 1, cv2.LINE_AA)
        cv2.line(canvas, (second[0], first[1]), second, INK, 1, cv2.LINE_AA)
    taken: list[tuple[int, int, int]] = []
    for dot in sorted(panel.dots, key=lambda dot: not dot.on_front):
        at = place(dot.seconds, dot.value)
        if dot.on_front:
            cv2.circle(canvas, at, 9, INK, 1, cv2.LINE_AA)
        _disc(canvas, at, 5, colours[dot.series])
        _label(canvas, dot.label, at, colours[dot.series], taken)
    _text(canvas, panel.title, (left, 42), 0.65)
    _text(canvas, time_axis, (left + (PANEL_WIDTH - _width(time_axis, 0.55)) // 2, PANEL_TOP + PANEL_HEIGHT + 46), 0.55)


def _label(
    canvas: NDArray, words: str, at: tuple[int, int], colour: tuple[int, int, int], taken: list[tuple[int, int, int]]
) -> None:
    """Beside the dot, at the first of a few places where no other label stands; left out where there is none."""
    width = _width(words, 0.42)
    for dx, dy in ((10, -6), (10, 14), (-width - 10, -6), (-width - 10, 14), (10, 26), (-width - 10, 26)):
        x, y = at[0] + dx, at[1] + dy
        if all(abs(y - other_y) >= 13 or x + width < start or end < x for start, end, other_y in taken):
            taken.append((x, x + width, y))
            _text(canvas, words, (x, y), 0.42, colour)
            return


def _disc(canvas: NDArray, at: tuple[int, int], radius: int, colour: tuple[int, int, int]) -> None:
    import cv2

    cv2.circle(canvas, at, radius, colour, -1, cv2.LINE_AA)


def _text(canvas: NDArray, words: str, at: tuple[int, int], size: float, colour: tuple[int, int, int] = INK) -> None:
    import cv2

    cv2.putText(canvas, words, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


def _width(words: str, size: float) -> int:
    import cv2

    return int(cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0][0])
