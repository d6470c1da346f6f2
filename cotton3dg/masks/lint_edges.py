"""Where lint ends in one image: a small network weighs the evidence of all images against the image's colours.

The rendered lint is right about where a boll is, but blurred by a pixel or two. Colours are sharp, but lint in its own
shade looks like a bur, and a pale wall looks like lint. The network learns from simulated plants how to decide between
them (`edge_training.py`).
"""

from __future__ import annotations

import threading
from functools import cache
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32
from ..errors import BadInput
from .weight_files import REINSTALL, read_shipped

CHANNELS: Final = 7
"""Number of the network's inputs for a pixel; `describe` computes them."""
NEIGHBOURS_PX: Final = 8.0
"""Standard deviation of a pixel's neighbourhood, whose colours of lint and of the rest it is compared with."""
SURELY: Final = 0.7
HARDLY: Final = 0.2
"""Rendered shares of lint above and below which a pixel shows what lint, and what the rest, looks like."""
LARGEST_PX: Final = 64.0
"""Bolls of more pixels are seen smaller: the network knows edges, and these are blurred over more pixels then."""
SHOWN: Final = 0.05
"""Least share of lint, rendered, in a pixel that can be lint."""
TILE_PX: Final = 32
REACH_PX: Final = 3
"""Side of the tiles that the network sees, and how far around a pixel it looks: most of an image shows no lint."""
EDGES_FILE: Final = Path(__file__).with_name("edges.onnx")
"""The weights that the program brings."""


def describe(image: NDArray[np.uint8], share: Float32, likely: Float32) -> Float32:
    """The network's inputs (CHANNELS, H, W).

    Where the pixel's colour lies from that of the rest around it (0) to that of the lint around it (1), how far beside
    that line, and how long the line is; share; likely; brightness over that of the lint around it; saturation.

    Args:
        image: (H, W, 3) sRGB.
        share: (H, W) rendered share of lint, 0..1.
        likely: (H, W) probability of lint that this image gives by itself.
    """
    colours = np.asarray(np.ascontiguousarray(image.transpose(2, 0, 1)) / np.float32(255), np.float32)
    lint, rest = (_mean_around(colours, where) for where in (share > SURELY, share < HARDLY))
    way, off = lint - rest, colours - rest
    square = (way**2).sum(axis=0) + np.float32(1e-3)
    along = ((off * way).sum(axis=0) / square).clip(-1, 2)
    beside = np.sqrt(((off - along * way) ** 2).sum(axis=0))
    brightness = (colours.mean(axis=0) / (lint.mean(axis=0) + np.float32(0.05))).clip(0, 2)
    saturation = colours.max(axis=0) - colours.min(axis=0)
    return np.stack([along, 3 * beside, np.sqrt(square), share, likely, brightness, saturation]).astype(np.float32)


def _mean_around(colours: Float32, where: NDArray[np.bool_]) -> Float32:
    """Mean colour (3, H, W) of the chosen pixels around each; towards black where there are none."""
    weights = where.astype(np.float32)
    *sums, total = (_smooth_halved(values) for values in (*(colours * weights), weights))
    size = where.shape[::-1]
    return np.stack([cv2.resize(channel / (total + np.float32(1e-3)), size) for channel in sums]).astype(np.float32)


def _smooth_halved(values: Float32) -> Float32:
    """(H/2, W/2): as smooth as at full size, for an eighth of the work."""
    halved = cv2.resize(values, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(halved, (0, 0), 0.5 * NEIGHBOURS_PX), np.float32)


class EdgeNetwork:
    """Weights ready to run, by any number of threads: each has a copy, as OpenCV's networks serve one at a time."""

    def __init__(self, weights: bytes, name: str):
        """
        Raises:
            BadInput: the weights are not a network of edges.
        """
        self._weights, self._own = weights, threading.local()
        try:
            shape = self._logits(np.zeros((1, CHANNELS, TILE_PX, TILE_PX), np.float32)).shape
        except cv2.error as error:
            raise BadInput(f"{name} is not a network of edges that OpenCV reads; {REINSTALL}") from error
        if shape != (1, TILE_PX, TILE_PX):
            raise BadInput(f"{name} is not a network of edges; {REINSTALL}")

    def find_lint(
        self, image: NDArray[np.uint8], share: Float32, likely: Float32, diameter_px: float
    ) -> NDArray[np.bool_]:
        """Which pixels (H, W) are lint; none whose share is below `SHOWN`.

        Args:
            share, likely: as `describe` takes them.
            diameter_px: usual width of a boll in the image.
        """
        shown = share > SHOWN
        factor = LARGEST_PX / max(diameter_px, LARGEST_PX)
        if factor == 1:
            return shown & (self._logits_where(shown, describe(image, share, likely)) > 0)
        size = max(round(image.shape[1] * factor), 1), max(round(image.shape[0] * factor), 1)
        smaller = [cv2.resize(whole, size, interpolation=cv2.INTER_AREA) for whole in (image, share, likely)]
        logits = self._logits_where(smaller[1] > SHOWN, describe(*smaller))
        lint: NDArray[np.bool_] = shown & (cv2.resize(logits, image.shape[1::-1], interpolation=cv2.INTER_LINEAR) > 0)
        return lint

    def _logits_where(self, where: NDArray[np.bool_], inputs: Float32) -> Float32:
        """Logits (H, W) of the inputs from `describe`, in all tiles that hold pixels of `where`; elsewhere -1."""
        height, width = where.shape
        rows, columns = -(-height // TILE_PX), -(-width // TILE_PX)
        below, right = rows * TILE_PX - height, columns * TILE_PX - width
        held = np.pad(where, ((0, below), (0, right))).reshape(rows, TILE_PX, columns, TILE_PX).any(axis=(1, 3))
        logits = np.full((rows, TILE_PX, columns, TILE_PX), -1, np.float32)
        places = np.argwhere(held)
        if len(places):
            wide = np.pad(inputs, ((0, 0), (REACH_PX, below + REACH_PX), (REACH_PX, right + REACH_PX)), mode="edge")
            side = TILE_PX + 2 * REACH_PX
            tiles = np.stack([wide[:, y : y + side, x : x + side] for y, x in TILE_PX * places])
            inner = slice(REACH_PX, -REACH_PX)
            logits.transpose(0, 2, 1, 3)[held] = self._logits(tiles)[:, inner, inner]
        return logits.reshape(rows * TILE_PX, columns * TILE_PX)[:height, :width]

    def _logits(self, inputs: Float32) -> Float32:
        """(B, H, W) of (B, CHANNELS, H, W)."""
        if not hasattr(self._own, "net"):
            self._own.net = cv2.dnn.readNetFromONNX(np.frombuffer(self._weights, np.uint8))
        self._own.net.setInput(inputs)
        return np.asarray(self._own.net.forward(), np.float32)[:, 0]


@cache
def open_edges() -> EdgeNetwork:
    """The network that the program brings.

    Raises:
        MissingInput, BadInput: the file is gone, or has changed.
    """
    return EdgeNetwork(read_shipped(EDGES_FILE), EDGES_FILE.name)
