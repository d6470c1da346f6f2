# SPDX-License-Identifier: Apache-2.0
"""Places in an image that can be found again in another: SIFT (Lowe 2004), by OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.machine import one_thread_each, usable_cores
from ..core.runs import Progress
from ..io.images import read_image

PEAK_THRESHOLD: Final = 0.002
"""Least difference of Gaussians, of images from 0 to 1. It is a third of COLMAP's: then a dark room's low contrast
still gives features, and in good light `max_features` is the limit anyway."""
OCTAVE_LAYERS: Final = 3
ROOT_SIFT_NORM: Final = 512
"""Length of a descriptor."""
NOTHING: Final[tuple[list[cv2.KeyPoint], NDArray[np.float32]]] = ([], np.zeros((0, 128), np.float32))


@dataclass(frozen=True)
class Features:
    """Features of one image, the best first."""

    places_px: NDArray[np.float32]
    """(N, 2) x, y; the corner of the first pixel is (0, 0), as COLMAP has it."""
    descriptors: NDArray[np.uint8]
    """(N, 128) RootSIFT (Arandjelović and Zisserman 2012), `ROOT_SIFT_NORM` long; zeros for places that were tracked
    into the image."""

    def joined(self, places_px: NDArray[np.float32]) -> Features:
        """The features with (M, 2) places added at the end."""
        none = np.zeros((len(places_px), self.descriptors.shape[1]), np.uint8)
        return Features(np.vstack([self.places_px, places_px]), np.vstack([self.descriptors, none]))


@dataclass(frozen=True)
class FeatureSettings:
    """How features are looked for."""

    most: int
    """Of an image."""
    max_side: int
    """Size at which features are looked for, px of the longer side; never more than twice that of the image."""
    far_apart: bool
    """Whether images are taken far from each other. Then the largest features are preferred, which survive a change of
    view; otherwise those with the most contrast, which are located to a smaller part of a pixel."""


def read_grey(path: Path) -> NDArray[np.uint8]:
    """(H, W) of an image file."""
    grey: NDArray[np.uint8] = cv2.cvtColor(read_image(path), cv2.COLOR_RGB2GRAY)
    return grey


def features_of_images(
    image_folder: Path, names: Sequence[str], chosen: Sequence[int], settings: FeatureSettings, progress: Progress
) -> dict[int, Features]:
    """Features of the chosen images, by their numbers in `names`; half of the way of structure from motion."""
    features = {}
    with one_thread_each(), ThreadPoolExecutor(len(usable_cores())) as threads:
        found = threads.map(lambda number: find_features(read_grey(image_folder / names[number]), settings), chosen)
        for done, (number, of_image) in enumerate(zip(chosen, found, strict=True)):
            progress(done // 2, 2 * len(names), "finding features")
            features[number] = of_image
    return features


def find_features(image: NDArray[np.uint8], settings: FeatureSettings) -> Features:
    """The features that are best found again.

    OpenCV doubles the image before it looks for features, so it gets the image at half of `max_side`. The detail that
    this loses is finer than the finest feature.

    Args:
        image: (H, W) grey.
    """
    height, width = image.shape
    scale = min(1.0, 0.5 * settings.max_side / max(width, height))
    size = max(1, round(scale * width)), max(1, round(scale * height))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    points, descriptors = _largest(small, settings.most) if settings.far_apart else _strongest(small, settings.most)
    if not points:
        return Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8))
    # OpenCV's (0, 0) is the middle of the first pixel.
    places = (np.asarray(cv2.KeyPoint.convert(points)) + 0.5) * np.array([width, height]) / size
    return Features(places.astype(np.float32), root_sift(descriptors))


def _strongest(image: NDArray[np.uint8], most: int) -> tuple[Sequence[cv2.KeyPoint], NDArray[np.float32]]:
    """Features with the most contrast, in falling order. To find and describe them at once takes a fifth less time."""
    points, descriptors = _detector(most).detectAndCompute(image, None)
    order = sorted(range(len(points)), key=lambda row: points[row].response, reverse=True)[:most]
    return ([points[row] for row in order], descriptors[order]) if order else NOTHING


def _largest(image: NDArray[np.uint8], most: int) -> tuple[Sequence[cv2.KeyPoint], NDArray[np.float32]]:
    detector = _detector(0)
    points = sorted(detector.detect(image), key=lambda point: point.size, reverse=True)[:most]
    return detector.compute(image, points) if points else NOTHING


def _detector(most: int) -> cv2.SIFT:
    """A detector of all features, or of those with the most contrast."""
    return cv2.SIFT.create(
        nfeatures=most,
        nOctaveLayers=OCTAVE_LAYERS,
        contrastThreshold=OCTAVE_LAYERS * PEAK_THRESHOLD,
        enable_precise_upscale=True,
    )


def root_sift(descriptors: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Descriptors (N, 128) whose Euclidean distance is the Hellinger distance of the given ones."""
    shares = descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6)
    rooted: NDArray[np.uint8] = np.round(ROOT_SIFT_NORM * np.sqrt(shares)).clip(0, 255).astype(np.uint8)
    return rooted
