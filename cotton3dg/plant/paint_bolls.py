"""From bolls in space to masks in one image: the volume says where a boll is, the image's colours where it ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float32
from .lint_volume import LintVolume, pixels_of

LIKELY = 0.25
"""Score of a pixel that may be painted."""
REACH = 3.0
"""How far a mask may go beyond the silhouette of its voxels, in voxels: undersides that burs hide from most views."""
SOFTNESS = 1.0
"""Voxels beyond the silhouette at which the odds for lint fall by e: the votes place an edge to about one voxel."""
LEVELS = 16
"""Bins of a histogram of one CIELAB channel."""
SPECK = 9
"""Pixels of the smallest piece of a mask."""


def paint_bolls(
    image: NDArray[np.uint8], score: Float32, camera: Camera, volume: LintVolume
) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Masks of the bolls of a volume in one image.

    Each boll's pixels compete with what surrounds it: naive Bayes on the CIELAB channels, the colours of all bolls
    of this image against those of the ring around this one, with the distance from the silhouette as prior. Before a
    brown wall all that is white is the boll; before a white one the silhouette decides what colours do not.

    Args:
        image: (H, W, 3) RGB.
        score: (H, W) 0..1, how much each pixel looks like lint.
    Returns:
        ids (H, W), the volume's boll numbers, 0 = no lint; and each painted boll's confidence.
    """
    import cv2

    expected, pitch_px = silhouettes(camera, volume)
    ids = np.zeros_like(expected)
    bolls = np.unique(expected[expected > 0])
    if not len(bolls):
        return ids, {}
    lint = score > LIKELY
    levels = cv2.cvtColor(image, cv2.COLOR_RGB2LAB) // (256 // LEVELS)
    outside = cv2.distanceTransform((expected == 0).astype(np.uint8), cv2.DIST_L2, 5)
    of_bolls = _histograms(levels[(expected > 0) & lint])
    best = np.zeros(expected.shape, np.float32)
    margin = int(np.ceil(2.5 * REACH * pitch_px))
    for boll in bolls:
        lines, columns = np.nonzero(expected == boll)
        window = np.s_[
            max(lines.min() - margin, 0) : lines.max() + margin + 1,
            max(columns.min() - margin, 0) : columns.max() + margin + 1,
        ]
        own = (expected[window] == boll).astype(np.uint8)
        away = cv2.distanceTransform(1 - own, cv2.DIST_L2, 5) - cv2.distanceTransform(own, cv2.DIST_L2, 5)
        ring = (outside[window] > REACH * pitch_px) & (away <= margin)
        likely = lint[window]
        around = _histograms(levels[window][ring & likely])
        density = (1 + (ring & likely).sum()) / (2 + ring.sum())
        odds = -away / (SOFTNESS * pitch_px) - np.log(density)
        for channel in range(3):
            odds += (of_bolls[channel] - around[channel])[levels[window][..., channel]]
        odds = cv2.GaussianBlur(np.clip(odds, -5, 5).astype(np.float32), (0, 0), 1.0)
        odds[~likely | (away > REACH * pitch_px)] = 0
        # Where two bolls reach for a pixel, the one in front there has it, else the likelier one.
        odds[(expected[window] != boll) & (expected[window] > 0)] = 0
        better = odds > best[window]
        best[window][better] = odds[better]
        ids[window][better] = boll
    ids = without_specks(ids)
    return ids, {int(boll): volume.confidence(boll) for boll in np.unique(ids[ids > 0])}


def _histograms(levels: NDArray[np.uint8]) -> list[NDArray[np.float64]]:
    """Logarithms of the frequencies of (N, 3) levels, a channel each, with one pixel more in every bin."""
    counts = [1.0 + np.bincount(levels[:, channel], minlength=LEVELS) for channel in range(3)]
    return [np.log(count / count.sum()) for count in counts]


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
