# SPDX-License-Identifier: Apache-2.0
"""Colours of the points of structure from motion, with which the training begins."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.machine import on_all_cores
from ..io.images import read_image


def colour_points(model: Any, image_folder: Path) -> None:
    """Give each point the mean colour of the places at which images show it.

    COLMAP's mapper does the same for the images that it adds itself, but not for those that are added one by one.

    Args:
        model: a pycolmap.Reconstruction of images in the folder; changed.
    """
    images = [model.image(image_id) for image_id in model.reg_image_ids()]
    seen = on_all_cores(lambda image: _seen(image, image_folder), images)
    ids = np.concatenate([np.zeros(0, np.int64), *(of_image for of_image, _ in seen)])
    colours = np.concatenate([np.zeros((0, 3)), *(of_image for _, of_image in seen)])
    points, rows = np.unique(ids, return_inverse=True)
    counts = np.bincount(rows, minlength=len(points))
    means = np.stack([np.bincount(rows, colours[:, k], len(points)) / counts for k in range(3)], axis=1)
    for point, colour in zip(points.tolist(), np.round(means).astype(np.uint8), strict=True):
        model.points3D[point].color = colour


def _seen(image: Any, folder: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Ids (n,) of the points that an image shows, and their colours in it (n, 3), RGB."""
    found = [(point.point3D_id, point.xy) for point in image.points2D if point.has_point3D()]
    if not found:
        return np.zeros(0, np.int64), np.zeros((0, 3))
    # COLMAP's (0, 0) is the corner of the first pixel, OpenCV's its middle.
    places = (np.array([xy for _, xy in found]) - 0.5).astype(np.float32)[:, None]
    colours = cv2.remap(
        read_image(folder / image.name), places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.array([point for point, _ in found], np.int64), colours[:, 0].astype(np.float64)
