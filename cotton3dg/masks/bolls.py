# SPDX-License-Identifier: Apache-2.0
"""The bolls' network, run by OpenCV: its maps of an image (`bolls_network` describes its heads)."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.network_maps import Maps, middles_of_pixels
from ..core.scene import Float32
from ..core.training_picture import CLASSES, OTHER
from ..errors import BadInput, MissingInput
from ..gaussians.rasterizer import Window
from .weight_files import read_shipped

CHANNELS: Final = len(CLASSES) + 4
"""Outputs of the network for a pixel: classes, x and y of the way to the middle, border, size, in this order."""
OFFSET_PX: Final = 32.0
"""Length of one unit of the way to the middle, and the size at 0 of the network's binary logarithmic scale."""
STRIDE: Final = 32
"""Sides of the network's input are multiples of this."""
IMAGE_SIDE: Final = 1280
"""Longer side of the network's input, px. Larger images are scaled down, smaller ones up, ..."""
LARGEST_ZOOM: Final = 2.0
"""... at most by this factor. Maps have half the size of the input, so small bolls need the enlargement."""
SURE: Final = 20.0
"""Logit that stands for certainty."""


def input_size(height: int, width: int, look: float = 1.0) -> tuple[int, int]:
    """Width and height, px, of the network's input for an image."""
    factor = look * min(LARGEST_ZOOM, IMAGE_SIDE / max(height, width))
    return max(round(width * factor), 1), max(round(height * factor), 1)


class BollNetwork:
    """Weights ready to run."""

    def __init__(self, weights: bytes, name: str):
        """
        Raises:
            BadInput: the weights are not a network, or not a network of bolls.
        """
        try:
            self._net = cv2.dnn.readNetFromONNX(np.frombuffer(weights, np.uint8))
        except cv2.error as error:
            raise BadInput(f"{name} is not a network that OpenCV reads; {REMEDY}") from error
        if self._raw(np.zeros((1, 3, STRIDE, STRIDE), np.float32), name).shape[1] != CHANNELS:
            raise BadInput(f"{name} is not a network of bolls; {REMEDY}")

    def maps(self, image: NDArray[np.uint8], look: float = 1.0, window: Window | None = None) -> Maps:
        """The network's maps of an (H, W, 3) sRGB image, scaled by the factor `look`.

        Args:
            window: the part that the network sees, to save time. Everything outside counts as not a plant.
        """
        height, width = image.shape[:2]
        size = input_size(height, width, look)
        smaller = size[0] < width
        seen = cv2.resize(image, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC)
        rows, columns = seen.shape[:2]
        below, right = -rows % STRIDE, -columns % STRIDE
        padded = cv2.copyMakeBorder(seen, 0, below, 0, right, cv2.BORDER_REPLICATE)
        raw = self._raw_within(padded, _in_strides(window, (height, width), (rows, columns), padded.shape))
        raw = raw[:, : -(-rows // 2), : -(-columns // 2)]
        logits = raw[: len(CLASSES)]
        powers = np.exp(logits - logits.max(axis=0))
        scale = max(height / rows, width / columns)
        way = raw[len(CLASSES) : len(CLASSES) + 2] * np.float32(OFFSET_PX * scale)
        return Maps(
            probabilities=powers / powers.sum(axis=0),
            votes=middles_of_pixels(raw.shape[1:], 2 * scale) + way,
            diameters=np.exp2(raw[len(CLASSES) + 3].clip(-3, 5)) * np.float32(OFFSET_PX * scale),
            scale=2 * scale,
            image_shape=(height, width),
        )

    def _raw_within(self, seen: NDArray[np.uint8], part: tuple[slice, slice]) -> Float32:
        """(CHANNELS, h, w) at half the size of `seen`; the network runs on a part of it only."""
        raw = np.zeros((CHANNELS, seen.shape[0] // 2, seen.shape[1] // 2), np.float32)
        raw[OTHER], raw[len(CLASSES) + 2] = SURE, -SURE
        half = tuple(slice(of_side.start // 2, of_side.stop // 2) for of_side in part)
        raw[:, *half] = self._raw(seen[part].transpose(2, 0, 1)[None].astype(np.float32))[0]
        return raw

    def _raw(self, blob: Float32, name: str = "the network") -> Float32:
        try:
            self._net.setInput(np.ascontiguousarray(blob))
            maps = self._net.forward()
        except cv2.error as error:
            raise BadInput(f"{name} does not take images; {REMEDY}") from error
        if maps.ndim != 4 or maps.shape[2] != blob.shape[2] // 2:
            raise BadInput(f"{name} is not a network of bolls; {REMEDY}")
        return np.asarray(maps, np.float32)


SHIPPED_FILE: Final = Path(__file__).with_name("bolls.onnx")
"""The weights that the program brings."""
REMEDY: Final = "give a network that masks-train made, or none for the one that comes with cotton3dg"


def open_bolls(weights: Path | None = None) -> BollNetwork:
    """The network of a file, or the one that the program brings.

    Raises:
        MissingInput: the file does not exist.
        BadInput: the file does not hold a network of bolls.
        EnvironmentUnusable: the network that comes with the program is missing or damaged.
    """
    if weights is None:
        return _shipped()
    if not weights.is_file():
        raise MissingInput(f"{weights} is not there; {REMEDY}")
    return BollNetwork(weights.read_bytes(), weights.name)


@cache
def _shipped() -> BollNetwork:
    return BollNetwork(read_shipped(SHIPPED_FILE), SHIPPED_FILE.name)


def _in_strides(
    window: Window | None, image: tuple[int, int], seen: tuple[int, int], padded: tuple[int, ...]
) -> tuple[slice, slice]:
    """Rows and columns of the network's input that hold a window of the image, in whole strides."""
    if window is None:
        return slice(0, padded[0]), slice(0, padded[1])
    rows, columns = (
        slice(
            math.floor(low * of_seen / of_image / STRIDE) * STRIDE,
            math.ceil((low + length) * of_seen / of_image / STRIDE) * STRIDE,
        )
        for low, length, of_seen, of_image in zip(window[1::-1], window[3:1:-1], seen, image, strict=True)
    )
    return rows, columns
