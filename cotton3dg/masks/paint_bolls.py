"""From bolls in space to masks in one image: the volume gives a boll's place, the image's colours give its edges."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float32
from .graph_cut import FEWEST, cut_groups
from .model_proximity import ModelProximity
from .voxel_voting import LintVolume, pixels_of

SURELY: Final = 0.5
LIKELY: Final = 0.25
"""Scores of a pixel that is lint if its place agrees, and of a pixel that the cut starts with as lint."""
CORE: Final = 1.0
"""Voxels inside the silhouettes where a sure score is trusted: the votes place an edge to about one voxel."""
SHARP_PX: Final = 3.0
"""Least such distance: chroma subsampling and compression blur edges by two pixels."""
REACH: Final = 8.0
BLIND_REACH: Final = 5.0
"""How far masks may go beyond the silhouettes, in voxels: burs hide the lower half of a boll, some 2.3 cm, from most
views. Where nothing separates a wall behind from lint, masks reach no farther than that half."""
NEAR: Final = 0.5
"""Least share of near things in the light of a pixel of lint."""
TRUSTED: Final = 0.8
"""Least share of the sure pixels of lint that are near by a model; a model with less is not used. Models of 480 and
960 px images reach 0.93 to 1, one of 240 px 0.85, one of 120 px, whose Gaussians are as wide as bolls, 0.2."""
NO_LINT: Final = 0.05
"""Score below which a near thing is not lint but bur, branch or leaf."""
MARGIN: Final = 4.0
"""Width of the surroundings that show things other than lint, in voxels beyond `REACH`."""
UNDECIDED: Final = 1.5
"""Voxels on either side of the border of two bolls within which the crease in the image decides."""
SPECK: Final = 9
"""Pixels of the smallest piece of a mask."""


def paint_bolls(
    image: NDArray[np.uint8],
    score: Float32,
    camera: Camera,
    volume: LintVolume,
    proximity: ModelProximity | None = None,
) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Masks of the bolls of a volume in one image.

    Args:
        image: (H, W, 3) RGB.
        score: (H, W) 0..1, how much each pixel looks like lint.
        proximity: to the volume; None = unknown. It also counts as unknown if the model is too coarse (`TRUSTED`).
    Returns:
        ids (H, W), the volume's boll numbers, 0 = no lint; and each painted boll's confidence.
    """
    expected, pitch_px = silhouettes(camera, volume)
    if not expected.any():
        return expected, {}
    if proximity is not None:
        shares, places = proximity.seen(camera)
        near = shares >= NEAR
        core = sure_pixels(score, expected, pitch_px)
    if proximity is not None and near[core].sum() >= TRUSTED * core.sum():
        lint = lint_pixels(image, score, expected, pitch_px, near)
        owners = np.zeros_like(expected)
        owners[lint] = proximity.bolls(places[lint])
    else:
        lint = lint_pixels(image, score, expected, pitch_px)
        owners = np.where(lint, nearest_silhouettes(expected), 0)
    ids = without_specks(divide(image, owners, pitch_px))
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


def sure_pixels(score: Float32, expected: NDArray[np.uint16], pitch_px: float) -> NDArray[np.bool_]:
    """Which pixels (H, W) deep inside the silhouettes have the colour of lint."""
    import cv2

    inside = cv2.distanceTransform((expected > 0).astype(np.uint8), cv2.DIST_L2, 5)
    sure: NDArray[np.bool_] = (score > SURELY) & (inside > max(CORE * pitch_px, SHARP_PX))
    return sure


def lint_pixels(
    image: NDArray[np.uint8],
    score: Float32,
    expected: NDArray[np.uint16],
    pitch_px: float,
    near: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Which pixels (H, W) on and around the silhouettes are lint: GrabCut (Rother et al. 2004).

    A minimum cut between colour models of lint and of what surrounds it follows the edges of the image, so lint goes on
    into its own shade and a wall of nearly its colour ends it. Bolls that are close share a model and a cut: what
    surrounds one must not be another.

    Args:
        near: (H, W) which pixels show things near the bolls. The others are not lint, and the model of the surroundings
            leaves out their colours: of burs and branches alone it is so unlike lint that shaded lint, too, falls on
            the right side. None = unknown.
    """
    import cv2

    reach = (BLIND_REACH if near is None else REACH) * pitch_px
    outside = cv2.distanceTransform((expected == 0).astype(np.uint8), cv2.DIST_L2, 5)
    trimap = np.full(expected.shape, cv2.GC_PR_BGD, np.uint8)
    trimap[(outside <= pitch_px) & (score > LIKELY)] = cv2.GC_PR_FGD
    sure = sure_pixels(score, expected, pitch_px)
    if near is not None:
        sure &= near
    # A boll may show so little of itself that no pixel lies deep inside; then all likely pixels count.
    small = np.bincount(expected[sure], minlength=int(expected.max()) + 1) < FEWEST
    trimap[sure | ((score > SURELY) & (expected > 0) & small[expected])] = cv2.GC_FGD
    within = outside <= reach
    trimap[~within if near is None else ~within | ~near] = cv2.GC_BGD
    margin_px = int(np.ceil(MARGIN * pitch_px))
    if near is None:
        return cut_groups(image, trimap, within, margin_px)
    return cut_groups(
        image, trimap, within, margin_px, lambda window: find_surrounded(image[window], score[window], near[window])
    )


def find_surrounded(image: NDArray[np.uint8], score: Float32, near: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The image (H, W, 3) with all far pixels in the colour of the near ones that are not lint, if there are any."""
    bare = near & (score < NO_LINT)
    if bare.sum() < FEWEST:
        return image
    return np.where(near[..., None], image, np.median(image[bare], axis=0).astype(np.uint8)).astype(np.uint8)


def nearest_silhouettes(expected: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """The boll (H, W) whose silhouette is nearest to each pixel."""
    import cv2

    _, places = cv2.distanceTransformWithLabels(
        (expected == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    boll_of_place = np.zeros(places.max() + 1, np.uint16)
    boll_of_place[places[expected > 0]] = expected[expected > 0]
    return boll_of_place[places]


def divide(image: NDArray[np.uint8], owners: NDArray[np.uint16], pitch_px: float) -> NDArray[np.uint16]:
    """The lint divided among its owners (H, W), 0 = no lint: along their borders a watershed lets the crease in the
    image decide.
    """
    import cv2

    lint = owners > 0
    radius = max(round(UNDECIDED * pitch_px), 1)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    largest = cv2.dilate(owners, disc)
    smallest = cv2.erode(np.where(lint, owners, np.iinfo(np.uint16).max).astype(np.uint16), disc)
    # Marker 1 is everything that is not lint, so that flooding stays within the lint.
    markers = np.where(lint, 0, 1).astype(np.int32)
    clear = lint & (largest == smallest)
    markers[clear] = owners[clear].astype(np.int32) + 1
    cv2.watershed(image, markers)
    return np.where(lint & (markers > 1), markers - 1, owners).astype(np.uint16)


def without_specks(ids: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """`ids` without pieces of fewer than `SPECK` pixels."""
    import cv2
    from scipy import ndimage

    kept = ids.copy()
    for boll, box in enumerate(ndimage.find_objects(ids), start=1):
        if box is not None:
            own = (ids[box] == boll).astype(np.uint8)
            _, pieces, facts, _ = cv2.connectedComponentsWithStats(own, connectivity=8)
            small = facts[:, cv2.CC_STAT_AREA] < SPECK
            kept[box][small[pieces] & (own > 0)] = 0
    return kept
