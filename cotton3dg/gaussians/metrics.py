# SPDX-License-Identifier: Apache-2.0
"""How well renders match photos, over the whole image and over the plant."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Gaussians
from ..geometry.camera_orbit import Orbit
from .rasterizer import render
from .views import View

PLANT_REGION: Final = 0.5
"""Radius of the plant region relative to the distance of the cameras from the centre of their orbit."""


@dataclass(frozen=True)
class ViewQuality:
    """One render against its photo, both rounded to 8 bits."""

    name: str
    psnr_db: float
    ssim: float
    plant_psnr_db: float
    """PSNR over the plant's pixels; NaN if the view does not show the plant."""
    plant_ssim: float
    plant_share: float
    """The plant's share of the pixels."""
    rendered: NDArray[np.uint8]
    """(H, W, 3) RGB."""


def view_quality(
    gaussians: Gaussians, view: View, plant: Orbit | NDArray[np.bool_], gains: NDArray[Any] | float = 1.0
) -> ViewQuality:
    """Render `gaussians` through the camera of `view` and compare.

    Args:
        plant: (H, W) the plant's pixels, the same for all models in a comparison. Or the orbit of all cameras: the
            plant is then the part that this model itself shows in a ball around the orbit's centre.
        gains: (3,) how much brighter the photo is than the images trained on (see exposure.py).
    """
    rendering = render(gaussians, view.camera)
    rendered = to_uint8(rendering.image * gains)
    if isinstance(plant, Orbit):
        plant = plant_region(view.camera, rendering.depth, plant.centre, PLANT_REGION * plant.distance)
    similarity = ssim_map(rendered, view.image)
    return ViewQuality(
        view.camera.name,
        psnr_db(rendered, view.image),
        float(similarity.mean()),
        psnr_db(rendered, view.image, plant),
        float(similarity[plant].mean()) if plant.any() else math.nan,
        float(plant.mean()),
        rendered,
    )


def mean_known(values: Iterable[float]) -> float:
    """Mean of the finite values; NaN without any."""
    finite = [value for value in values if math.isfinite(value)]
    return float(np.mean(finite)) if finite else math.nan


def to_uint8(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Rounded to 8 bits as it would be saved; values that are not finite become 0."""
    levels: NDArray[np.uint8] = np.rint(np.clip(np.nan_to_num(image), 0.0, 1.0) * 255.0).astype(np.uint8)
    return levels


def psnr_db(first: NDArray[np.uint8], second: NDArray[np.uint8], region: NDArray[np.bool_] | None = None) -> float:
    """Peak signal-to-noise ratio of two (H, W, 3) images over a (H, W) region, dB.

    NaN for an empty region. Equal images give the value of half a grey level of error in one of all samples rather
    than infinity, so that means stay finite.
    """
    difference = first.astype(np.float64) - second
    if region is not None:
        difference = difference[region]
    if difference.size == 0:
        return math.nan
    error = max(float(np.mean(difference**2)), 0.25 / difference.size)
    return 10.0 * math.log10(255.0**2 / error)


def ssim_map(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.float64]:
    """(H, W) structural similarity (Wang et al. 2004), 11 px Gaussian window of σ 1.5, mean of the channels.

    The border is mirrored, so that images of any size have a value at every pixel.
    """
    import cv2

    a, b = first.astype(np.float64), second.astype(np.float64)

    def blurred(image: NDArray[np.float64]) -> NDArray[np.float64]:
        smooth: NDArray[np.float64] = cv2.GaussianBlur(image, (11, 11), 1.5, borderType=cv2.BORDER_REFLECT)
        return smooth

    mean_a, mean_b = blurred(a), blurred(b)
    variance_a, variance_b = blurred(a * a) - mean_a**2, blurred(b * b) - mean_b**2
    covariance = blurred(a * b) - mean_a * mean_b
    c1, c2 = (0.01 * 255.0) ** 2, (0.03 * 255.0) ** 2
    similarity = (2 * mean_a * mean_b + c1) * (2 * covariance + c2)
    similarity /= (mean_a**2 + mean_b**2 + c1) * (variance_a + variance_b + c2)
    over_channels: NDArray[np.float64] = similarity.mean(axis=2)
    return over_channels


def plant_region(camera: Camera, depth: NDArray[Any], centre: NDArray[Any], radius_su: float) -> NDArray[np.bool_]:
    """(H, W) pixels whose surface, at the rendered `depth`, lies within `radius_su` of `centre`."""
    y, x = np.mgrid[0.5 : camera.height, 0.5 : camera.width]
    rays = camera.rays(np.stack([x, y], axis=-1))
    in_camera = camera.rotation @ np.asarray(centre, np.float64) + camera.cam_from_scene[:, 3]
    distance = np.linalg.norm(rays * np.asarray(depth, np.float64)[..., None] - in_camera, axis=-1)
    near: NDArray[np.bool_] = np.isfinite(distance) & (depth > 0) & (distance <= radius_su)
    return near
