# SPDX-License-Identifier: Apache-2.0
"""Where labels of a drawing go, so that none hides another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

CHARACTER: Final = 0.58
"""Width of a character of a sans-serif font, in its size; the mean of letters and digits."""
PAD_PX: Final = 1.5
OVERLAP: Final = 100.0
CROSSING: Final = 4.0
DISTANCE: Final = 0.02
"""Cost of hiding the whole area of a label, of lying on a line over its full length, and of each pixel of distance."""
Box = tuple[float, float, float, float]
"""Left, top, right, bottom, px."""


@dataclass(frozen=True)
class Spot:
    """A possible place of a label, relative to what it names: x, y of its baseline, px, and its text-anchor."""

    x: float
    y: float
    anchor: str


def text_box(x: float, y: float, text: str, anchor: str, size: float) -> Box:
    """The approximate box of a text whose baseline is at y."""
    width = CHARACTER * size * len(text)
    left = x - width * {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor]
    return left - PAD_PX, y - 0.8 * size - PAD_PX, left + width + PAD_PX, y + 0.22 * size + PAD_PX


@dataclass
class Labels:
    """The places in a drawing that labels and lines already take."""

    taken: list[Box] = field(default_factory=list)
    """Boxes that no label may cover."""
    lines: list[NDArray[np.float64]] = field(default_factory=list)
    """(N, 2) px each: points along lines that labels avoid."""

    def add_line(self, start: Sequence[float], end: Sequence[float]) -> None:
        """Add a straight line."""
        self.lines.append(np.linspace(start, end, max(2, int(np.hypot(*np.subtract(end, start)) / 3))))

    def place(self, at: Sequence[float], text: str, size: float, spots: Iterable[Spot]) -> Spot:
        """Choose the best of the spots for a label and mark it as taken. Earlier spots are preferred.

        Returns:
            Where the label goes, px of the drawing.
        """
        best, least, found = Spot(at[0], at[1], "middle"), np.inf, (0.0, 0.0, 0.0, 0.0)
        others = np.array(self.taken).reshape(-1, 4)
        line = np.concatenate(self.lines) if self.lines else np.zeros((0, 2))
        for spot in spots:
            x, y = at[0] + spot.x, at[1] + spot.y
            box = text_box(x, y, text, spot.anchor, size)
            wide = np.clip(np.minimum(others[:, 2], box[2]) - np.maximum(others[:, 0], box[0]), 0, None)
            high = np.clip(np.minimum(others[:, 3], box[3]) - np.maximum(others[:, 1], box[1]), 0, None)
            hidden = float((wide * high).sum()) / ((box[2] - box[0]) * (box[3] - box[1]))
            on_line = int(((line > box[:2]) & (line < box[2:])).all(axis=1).sum())
            cost = (
                OVERLAP * hidden
                + CROSSING * 3 * on_line / (box[2] - box[0])
                + DISTANCE * float(np.hypot(spot.x, spot.y))
            )
            if cost < least - 1e-9:
                best, least, found = Spot(x, y, spot.anchor), cost, box
        self.taken.append(found)
        return best


def around(radius: float, size: float) -> list[Spot]:
    """Spots around a circle: below, above, beside it, and farther out."""
    spots = []
    for ring in range(5):
        away = radius + 3 + ring * 0.9 * size
        for turn in (90, -90, 0, 180, 45, 135, -45, -135, 70, 110, -70, -110, 20, 160, -20, -160):
            x, y = away * np.cos(np.radians(turn)), away * np.sin(np.radians(turn))
            anchor = "middle" if abs(x) < 0.4 * away else "start" if x > 0 else "end"
            # The baseline: below the circle the text hangs from it, above it stands on it.
            spots.append(Spot(float(x), float(y + 0.4 * size * (1 + np.sin(np.radians(turn)))), anchor))
    return spots


def beside(outwards: int, size: float) -> list[Spot]:
    """Spots at the end of a line: outwards of it, then higher and lower."""
    anchor = "start" if outwards > 0 else "end"
    steps = sorted((step for step in range(-6, 7)), key=abs)
    return [Spot(outwards * (14.0 + 10 * far), -8.0 + 0.7 * size * step, anchor) for far in range(4) for step in steps]
