# SPDX-License-Identifier: Apache-2.0
"""The network sees one image at several sizes, and once more sharpened and mirrored. It knows bolls of some sizes
better than others, and those in focus best; and the mean of two looks errs less if the looks differ more."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.network_maps import Maps, middles_of_pixels
from ..core.scene import Float32
from .bolls import BollNetwork

LOOKS: Final = (1.0, 0.5, 0.25)
"""Sizes, relative to `input_size`, at which the network sees an image. It recognises a boll that fills the image only
at a small size."""
EDGES_PX: Final = 3.0
EDGES_GAIN: Final = 1.5
"""Sharpening adds the details finer than `EDGES_PX` to the image, times `EDGES_GAIN`."""
FAMILIAR_PX: Final = 90.0
"""Width of the bolls that the network knows best, in pixels of its input. ..."""
FAMILIAR_OCTAVES: Final = 1.0
"""... Standard deviation, in octaves of the width, of the weight of other bolls."""


def predict_with_augmentation(image: NDArray[np.uint8], network: BollNetwork) -> Maps:
    """The network's maps of an (H, W, 3) sRGB image, and of it sharpened and mirrored, all `LOOKS` together."""
    other = np.ascontiguousarray(sharpen(image)[:, ::-1])
    as_it_is = [network.maps(image, look) for look in LOOKS]
    return merge_maps(as_it_is + [mirror(network.maps(other, look)) for look in LOOKS])


def mirror(maps: Maps) -> Maps:
    """The maps of an image from those of its mirror image."""
    across, down = maps.votes[..., ::-1]
    return replace(
        maps,
        probabilities=maps.probabilities[..., ::-1],
        votes=np.stack([maps.image_shape[1] - across, down]),
        diameters=maps.diameters[:, ::-1],
    )


def sharpen(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An image (H, W, 3) with stronger edges (unsharp mask)."""
    soft = cv2.GaussianBlur(image, (0, 0), EDGES_PX)
    return np.asarray(cv2.addWeighted(image, 1 + EDGES_GAIN, soft, -EDGES_GAIN, 0), np.uint8)


def merge_maps(looks: Sequence[Maps]) -> Maps:
    """Mix the maps of several looks at one image, at the size of the first. Where bolls are large, the looks in which
    they are small count most."""
    first = looks[0]
    height, width = first.lint.shape
    fitted = [_resize_maps(maps, height, width) for maps in looks]
    octaves = np.mean([np.log2(maps.diameters) for maps in fitted], axis=0)
    trust = np.stack(
        [np.exp(-0.5 * ((octaves - np.log2(FAMILIAR_PX * maps.scale / 2)) / FAMILIAR_OCTAVES) ** 2) for maps in looks]
    )
    trust = (trust + 1e-6) / (trust + 1e-6).sum(axis=0)

    def mean(parts: Iterable[Float32]) -> Float32:
        averaged: Float32 = np.sum(
            [share * part for share, part in zip(trust, parts, strict=True)], axis=0, dtype=np.float32
        )
        return averaged

    return replace(
        first,
        probabilities=mean(maps.probabilities for maps in fitted),
        votes=mean(maps.votes for maps in fitted),
        diameters=np.exp2(mean(np.log2(maps.diameters) for maps in fitted)),
    )


def _resize_maps(maps: Maps, height: int, width: int) -> Maps:
    """The maps with as many pixels as those of another look."""
    if maps.lint.shape == (height, width):
        return maps

    def resize(part: Float32) -> Float32:
        resized: Float32 = cv2.resize(part.transpose(1, 2, 0), (width, height))
        return resized.reshape(height, width, -1).transpose(2, 0, 1)  # OpenCV drops a single channel

    scale = maps.image_shape[1] / width
    ways = resize(maps.votes - middles_of_pixels(maps.lint.shape, maps.scale))
    return Maps(
        probabilities=resize(maps.probabilities),
        votes=ways + middles_of_pixels((height, width), scale),
        diameters=np.exp2(resize(np.log2(maps.diameters)[None])[0]),
        scale=scale,
        image_shape=maps.image_shape,
    )
