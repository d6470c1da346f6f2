"""Open cotton bolls in the images of one plant, found without any trained weights.

In each image pixels may be lint by their colour: bright for their light and hardly coloured. Posters, labels and walls
have such colours, too, and touching bolls look like one. So the images vote on where in space lint is (`lint_volume`),
that lint is divided into bolls there (`split_touching`), and each image paints the bolls on its own pixels
(`paint_bolls`). Small images do all that first; their masks vote again, on the bolls' shapes, and then the images are
painted at full size. A trained model of the plant adds what is near which boll (`proximity`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import MaskSet
from ..core.progress import Progress, silent
from ..core.scene import Camera, Float32, Float64, Gaussians
from ..geometry.camera_orbit import Orbit
from ..geometry.planes import level_planes
from .model_proximity import ModelProximity
from .paint_bolls import REACH, paint_bolls
from .voxel_voting import LintVolume, find_bolls, refine_bolls

SHADE: Final = (0.2, 0.6)
"""Luminance, relative to the image's white, at which lint is impossible and certain."""
CHROMA: Final = (12.0, 22.0)
"""CIELAB chroma at which lint is certain and impossible: cream-coloured lint, colour cast and chroma subsampling."""
PALE: Final = 0.35
"""Largest difference of linear red, green and blue, relative to the largest of them, of what may be white."""
_CODES: Final = np.arange(256) / 255
_LINEAR: Final = np.where(_CODES <= 0.04045, _CODES / 12.92, ((_CODES + 0.055) / 1.055) ** 2.4).astype(np.float32)
"""Linear light of each sRGB code (IEC 61966-2-1)."""
VOTING_SIDE_PX: Final = 640
"""Longer side of the images that vote. A voxel is then about two pixels wide, and finer detail does not matter."""
FLOOR: Final = 0.1
"""Least height of the orbit's centre, which is amid the plant, above what the plant stands on, R."""


def detect_lint(
    images: Sequence[NDArray[np.uint8]],
    cameras: Sequence[Camera],
    orbit: Orbit,
    points: Float64,
    painted: Collection[str],
    progress: Progress = silent,
    voters: Collection[str] | None = None,
    gaussians: Gaussians | None = None,
) -> MaskSet:
    """Masks of the open bolls in images from around one plant.

    Args:
        images: (H, W, 3) RGB, undistorted.
        cameras: of these images.
        orbit: that the plant stands in.
        points: (P, 3) su, on surfaces in the scene; the table is found from them.
        painted: names of the cameras that get masks.
        voters: names of those that vote on where lint is; None = all.
        gaussians: trained model of the plant; without one, things around a boll with the colour of lint may count as
            lint.
    Returns:
        By camera name; a boll has the same id in all images.
    """
    import cv2

    voting = [view for view in zip(images, cameras, strict=True) if voters is None or view[1].name in voters]
    total = 2 * len(voting) + len(painted)
    small, small_cameras, scores, rough = [], [], [], []
    for done, (image, camera) in enumerate(voting):
        progress(done, total, "looking for lint")
        factor = min(VOTING_SIDE_PX / max(camera.width, camera.height), 1.0)
        width, height = (max(round(factor * side), 1) for side in (camera.width, camera.height))
        small_cameras.append(camera.resized(width, height))
        small.append(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8))
        scores.append(lint_score(small[-1]))
    progress(len(voting), total, "comparing the views")
    volume = find_bolls(scores, small_cameras, orbit, plant_floor(points, orbit))
    proximity = _proximity(gaussians, volume)
    for done, view in enumerate(zip(small, scores, small_cameras, strict=True)):
        progress(len(voting) + done, total, "outlining the bolls")
        rough.append(paint_bolls(*view, volume, proximity)[0])
    volume = refine_bolls(volume, rough, small_cameras)
    proximity = _proximity(gaussians, volume)
    masks = MaskSet({}, {})
    for image, camera in zip(images, cameras, strict=True):
        if camera.name in painted:
            painting = paint_bolls(image, lint_score(image), camera, volume, proximity)
            masks.ids[camera.name], masks.scores[camera.name] = painting
            progress(2 * len(voting) + len(masks.ids), total, camera.name)
    return masks


def _proximity(gaussians: Gaussians | None, volume: LintVolume) -> ModelProximity | None:
    return ModelProximity(gaussians, volume, REACH) if gaussians and len(volume.voxels) else None


def plant_floor(points: Float64, orbit: Orbit) -> Float64 | None:
    """The level plane (4,) that the plant stands on: the highest below the middle of the images; None without one."""
    for plane in level_planes(points, orbit):
        if plane[:3] @ orbit.centre + plane[3] > FLOOR * orbit.radius:
            return plane
    return None


def lint_score(image: NDArray[np.uint8]) -> Float32:
    """How much each pixel's colour is that of lint, 0..1.

    All light is taken relative to the image's own white, the 99.5th percentile of the hardly coloured pixels, so that
    neither exposure nor its drift matters.

    Args:
        image: (H, W, 3) RGB.
    """
    import cv2

    linear = _LINEAR[image]
    luminance = linear @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    brightest = linear.max(axis=2)
    pale = luminance[(brightest - linear.min(axis=2) < PALE * brightest)]
    white = float(np.percentile(pale, 99.5)) if len(pale) else 0.0
    if white <= 0:
        return np.zeros(image.shape[:2], np.float32)
    lab = cv2.cvtColor(np.minimum(linear / np.float32(white), 1), cv2.COLOR_LRGB2LAB)
    chroma = np.hypot(lab[..., 1], lab[..., 2])
    bright = np.clip((luminance / white - SHADE[0]) / (SHADE[1] - SHADE[0]), 0, 1)
    score: Float32 = (bright * np.clip((CHROMA[1] - chroma) / (CHROMA[1] - CHROMA[0]), 0, 1)).astype(np.float32)
    return score


def draw_overlay(image: NDArray[np.uint8], ids: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """The image with each mask tinted and outlined in a colour of its own, for looking."""
    import cv2

    drawn = image.copy()
    for label in np.unique(ids[ids > 0]):
        # Multiples of the golden angle keep neighbouring ids apart in hue.
        hue = np.array([[[int(label * 137.5 / 2) % 180, 255, 255]]], np.uint8)
        colour = cv2.cvtColor(hue, cv2.COLOR_HSV2RGB)[0, 0]
        mask = ids == label
        drawn[mask] = (0.65 * drawn[mask] + 0.35 * colour).astype(np.uint8)
        outline, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(drawn, outline, -1, colour.tolist(), 1)
    return drawn
