# SPDX-License-Identifier: Apache-2.0
"""Frames as decoders give them: brightness at full size, colour at half of it (4:2:0)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .images import fit_size
from .tonemap import tone_map

LUMA_WEIGHTS: Final = {"bt709": (0.2126, 0.0722), "bt2020nc": (0.2627, 0.0593), "bt2020c": (0.2627, 0.0593)}
"""Weights of red and blue, by ffmpeg's name of a matrix (ITU-R BT.709, BT.2020); ..."""
USUAL_WEIGHTS: Final = (0.299, 0.114)
"""... and for all others (BT.601), which ffmpeg takes if a file does not say."""


@dataclass(frozen=True)
class Coding:
    """How a stream's numbers stand for colours."""

    width: int
    height: int
    bits: int = 8
    """10 for HDR."""
    full_range: bool = False
    """Whether black is 0 instead of 16 (of 255)."""
    matrix: str = ""
    transfer: str = ""
    """Transfer function of HDR, which is tone-mapped."""

    @property
    def pixel_format(self) -> str:
        """ffmpeg's name of the pixel format."""
        return ("yuvj420p" if self.full_range else "yuv420p") if self.bits == 8 else "yuv420p10le"

    @property
    def kind(self) -> Any:
        return np.uint8 if self.bits == 8 else np.dtype("<u2")

    @property
    def size(self) -> int:
        """Numbers per frame."""
        return self.width * self.height + 2 * self.chroma_width * self.chroma_height

    @property
    def chroma_width(self) -> int:
        return (self.width + 1) // 2

    @property
    def chroma_height(self) -> int:
        return (self.height + 1) // 2


@dataclass(frozen=True)
class YuvFrame:
    """One frame; its numbers are overwritten by the next one unless they are copied."""

    coding: Coding
    numbers: NDArray[Any]
    """(size,) planes one after the other."""

    @property
    def luma(self) -> NDArray[Any]:
        """(H, W)"""
        return self.numbers[: self.coding.width * self.coding.height].reshape(self.coding.height, self.coding.width)

    def grey(self, max_side: int) -> NDArray[np.uint8]:
        """(h, w) brightness 0..255, its longer side at most `max_side` px; the caller's own."""
        import cv2

        coding = self.coding
        size = fit_size(coding.width, coding.height, max_side)
        small = self.luma if size == (coding.width, coding.height) else _shrink(self.luma, size)
        scale = 2.0 ** (coding.bits - 8)
        gain, black = (1 / scale, 0.0) if coding.full_range else (255 / (219 * scale), 16 * scale)
        if coding.full_range and coding.bits == 8:
            return np.array(small, np.uint8)
        # OpenCV takes the absolute value of pixels that are darker than black; the difference is negligible.
        return np.asarray(cv2.convertScaleAbs(small, alpha=gain, beta=-black * gain), np.uint8)

    def rgb(self) -> NDArray[np.uint8]:
        """(H, W, 3) sRGB; HDR is tone-mapped."""
        import cv2

        coding = self.coding
        n, side = coding.width * coding.height, (coding.chroma_height, coding.chroma_width)
        chroma = self.numbers[n:].reshape(2, *side)
        size = (coding.width, coding.height)
        planes = [self.luma, *(_enlarge(plane, size) for plane in chroma)]
        rgb = cv2.transform(cv2.merge(planes), _to_rgb(coding))
        return tone_map(rgb, coding.transfer) if coding.bits > 8 else np.asarray(rgb, np.uint8)


def _enlarge(chroma: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """Enlarge chroma to full size. A sample stands in the middle of its four pixels, as converters assume; some cameras
    place it a quarter of its width to the left, which nobody sees."""
    import cv2

    twice: NDArray[Any] = cv2.resize(chroma, (2 * chroma.shape[1], 2 * chroma.shape[0]), interpolation=cv2.INTER_LINEAR)
    return twice[: size[1], : size[0]]


def _shrink(luma: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """Smaller by the mean of pixels; very large frames use only every second one."""
    import cv2

    step = 2 if luma.shape[1] >= 4 * size[0] else 1
    smaller: NDArray[Any] = cv2.resize(luma[::step, ::step], size, interpolation=cv2.INTER_AREA)
    return smaller


def _to_rgb(coding: Coding) -> NDArray[np.float64]:
    """(3, 4) from Y, Cb, Cr to red, green, blue of 8 bits, or of 16 for more than 8."""
    red, blue = LUMA_WEIGHTS.get(coding.matrix, USUAL_WEIGHTS)
    green = 1 - red - blue
    scale = 2.0 ** (coding.bits - 8)
    black, white, chroma = (0.0, 255.0, 255.0) if coding.full_range else (16.0, 219.0, 224.0)
    whole = 255.0 if coding.bits == 8 else 65535.0
    y, c = whole / (white * scale), 2 * whole / (chroma * scale)
    matrix = np.array(
        [
            [y, 0, c * (1 - red)],
            [y, -c * (1 - blue) * blue / green, -c * (1 - red) * red / green],
            [y, c * (1 - blue), 0],
        ]
    )
    zero = np.array([black, 128.0, 128.0]) * scale
    return np.column_stack([matrix, -matrix @ zero])
