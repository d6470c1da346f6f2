"""Open cotton bolls in the images of one plant, found without any trained weights.

Colour says in each image what may be lint: bright for its light and hardly coloured. Posters, labels and walls may be
that too, and touching bolls look like one; so the images vote on where in space lint is (`lint_volume`), that lint
is divided into bolls there (`split_touching`), and each image paints the bolls on its own pixels.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import MaskSet
from ..core.progress import Progress, silent
from ..core.scene import Camera, Float32, Float64
from .lint_volume import LintVolume, find_bolls, pixels_of
from .table import level_planes
from .views import Orbit

SHADE = (0.2, 0.6)
"""Luminance, relative to the image's white, at which lint is impossible and certain."""
CHROMA = (12.0, 22.0)
"""CIELAB chroma at which lint is certain and impossible: cream-coloured lint, colour cast and chroma subsampling."""
LIKELY = 0.25
"""Score of a pixel that is painted where lint is expected."""
GROWTH, CORE = 3.0, 0.5
"""How far a mask may go beyond the silhouette of its voxels, and the edge of this that is left open, in voxels."""
SPECK = 9
"""Pixels of the smallest piece of a mask."""
FLOOR = 0.1
"""Least height of the orbit's centre, which is amid the plant, above what the plant stands on, R."""
BACKGROUND = 65536
"""Marker of what is no boll; ids have 16 bits."""


def detect_lint(
    images: Sequence[NDArray[np.uint8]],
    cameras: Sequence[Camera],
    orbit: Orbit,
    points: Float64,
    progress: Progress = silent,
) -> MaskSet:
    """Masks of the open bolls in images from around one plant.

    Args:
        images: (H, W, 3) RGB, undistorted.
        cameras: of these images.
        orbit: that the plant stands in.
        points: (P, 3) su, of surfaces in the scene; they tell where the table is.
    Returns:
        By camera name; a boll has the same id in all images.
    """
    scores = []
    for done, image in enumerate(images):
        progress(done, 2 * len(images), "looking for lint")
        scores.append(lint_score(image))
    progress(len(images), 2 * len(images), "comparing the views")
    volume = find_bolls(scores, cameras, orbit, plant_floor(points, orbit))
    masks = MaskSet({}, {})
    for done, (image, score, camera) in enumerate(zip(images, scores, cameras, strict=True), start=len(images) + 1):
        masks.ids[camera.name], masks.scores[camera.name] = paint_bolls(image, score, camera, volume)
        progress(done, 2 * len(images), camera.name)
    return masks


def plant_floor(points: Float64, orbit: Orbit) -> Float64 | None:
    """The level plane (4,) that the plant stands on: the highest below the middle of the images; None without one."""
    for plane in level_planes(points, orbit):
        if plane[:3] @ orbit.centre + plane[3] > FLOOR * orbit.radius:
            return plane
    return None


def lint_score(image: NDArray[np.uint8]) -> Float32:
    """How much each pixel's colour is that of lint, 0..1.

    Relative to the image's own white, the 99.5th percentile of what is hardly coloured, so that neither exposure nor
    its drift matters.

    Args:
        image: (H, W, 3) RGB.
    """
    import cv2

    lab = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    chroma = np.hypot(lab[..., 1], lab[..., 2])
    # CIE 1976: the cube of (L + 16) / 116 is the luminance.
    luminance = ((lab[..., 0] + 16) / 116) ** 3
    pale = luminance[chroma < CHROMA[0]]
    if not len(pale):
        return np.zeros(image.shape[:2], np.float32)
    white = max(float(np.percentile(pale, 99.5)), 1e-3)
    bright = np.clip((luminance / white - SHADE[0]) / (SHADE[1] - SHADE[0]), 0, 1)
    return bright * np.clip((CHROMA[1] - chroma) / (CHROMA[1] - CHROMA[0]), 0, 1)


def paint_bolls(
    image: NDArray[np.uint8], score: Float32, camera: Camera, volume: LintVolume
) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Masks of the bolls of a volume in one image.

    The volume says which boll is where, to within a voxel or two; the image's own edges say where it ends: watershed
    (Meyer 1992) between pixels that must be a boll and pixels that cannot be one.

    Returns:
        ids (H, W), the volume's boll numbers, 0 = no lint; and each painted boll's confidence.
    """
    import cv2

    expected, pitch_px = silhouettes(camera, volume)
    if not expected.any():
        return expected, {}
    lint = score > LIKELY
    reach = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * round(GROWTH * pitch_px) + 1,) * 2)
    markers = np.where(cv2.dilate(expected, reach) > 0, 0, BACKGROUND).astype(np.int32)
    markers[~lint] = BACKGROUND
    size = 2 * max(1, round(CORE * pitch_px)) + 1
    core = np.ones((size, size), np.uint8)
    same = cv2.erode(expected, core) == cv2.dilate(expected, core)
    sure = same & (expected > 0) & lint
    markers[sure] = expected[sure]
    ids = cv2.watershed(image, markers)
    ids = np.where((ids > 0) & (ids < BACKGROUND) & lint, ids, 0).astype(np.uint16)
    ids = without_specks(ids)
    return ids, {int(boll): volume.confidence(boll) for boll in np.unique(ids[ids > 0])}


def silhouettes(camera: Camera, volume: LintVolume) -> tuple[NDArray[np.uint16], float]:
    """Number of the boll in front at each pixel (H, W), 0 = none, and the median width of a voxel in px."""
    columns, lines, inside, depths = pixels_of(volume.centres, camera)
    ids = np.zeros((camera.height, camera.width), np.uint16)
    # Painted from far to near: of pixels assigned twice numpy keeps the last.
    order = np.flatnonzero(inside)
    order = order[np.argsort(-depths[order], kind="stable")]
    if not len(order):
        return ids, 1.0
    pitch_px = float(np.median(volume.pitch * camera.fx / depths[order]))
    half = int(np.ceil(pitch_px / 2))
    offsets = np.arange(-half, half + 1)
    y = np.clip(lines[order, None, None] + offsets[:, None], 0, camera.height - 1)
    x = np.clip(columns[order, None, None] + offsets[None, :], 0, camera.width - 1)
    ids[y, x] = volume.bolls[order, None, None]
    return ids, pitch_px


def without_specks(ids: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """`ids` without pieces of fewer than `SPECK` pixels."""
    import cv2

    kept = ids.copy()
    for boll in np.unique(ids[ids > 0]):
        _, pieces, facts, _ = cv2.connectedComponentsWithStats((ids == boll).astype(np.uint8), connectivity=8)
        small = facts[:, cv2.CC_STAT_AREA] < SPECK
        kept[small[pieces] & (ids == boll)] = 0
    return kept


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
