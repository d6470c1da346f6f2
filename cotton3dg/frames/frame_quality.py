# SPDX-License-Identifier: Apache-2.0
"""Judging a capture before any 3D: sharpness, exposure, motion, and which frames of a video to take."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64

Grey = NDArray[np.uint8]

STILL_DISPLACEMENT: Final = 0.002
"""Share of the image width that corners move from image to image; a full turn moves them ten and more times as far."""
BLURRED: Final = 0.4
"""`blur` at 640 px that a Gaussian of about 1.3 px, 2.6 px in a video of 1280, gives to a crisp room."""
BLANK_CONTRAST: Final = 1.0
"""Standard deviation of the grey values, of 255, below which a frame shows nothing: black, white, a covered lens."""
REPEATED_SHARE: Final = 0.1
"""Change from the frame before, relative to the median change, below which a frame repeats that frame. Even a repeated
frame that is encoded anew as a key frame changes less, and the picture of a moving camera changes more."""
DARK_HIGHLIGHT: Final = 0.55
"""`highlight` below which images are dark: 0.37 to 0.46 in simulated rooms two stops too dark, 0.64 and more in others.
The mean would take a black cloth behind a well lit plant for darkness."""
HIGHLIGHT_PERCENT: Final = 98
BURNT_SHARE: Final = 0.3


def sharpness(grey: Grey) -> float:
    """Variance of the Laplacian of (H, W) grey values; compares frames of one scene, not scenes with each other.

    Source: Pech-Pacheco et al., Diatom autofocusing in brightfield microscopy, ICPR 2000.
    """
    import cv2

    return float(cv2.meanStdDev(cv2.Laplacian(grey, cv2.CV_16S))[1].item() ** 2)


def blur(grey: Grey) -> float:
    """How blurred an image is, 0 (crisp) to 1, nearly independent of what it shows.

    The share of the neighbouring-pixel variation that survives a second blurring by a box of 11 px, the worse of the
    two directions: crisp images lose most of it, blurred ones little.
    Source: Crete et al., The blur effect, SPIE 2007.
    """
    import cv2

    image = grey.astype(np.float32)
    worst = 0.0
    for axis, kernel in ((0, (1, 11)), (1, (11, 1))):
        variation = np.abs(np.diff(image, axis=axis))
        blurred = np.abs(np.diff(cv2.blur(image, kernel), axis=axis))
        total = float(variation.sum())
        lost = float(np.maximum(variation - blurred, 0).sum())
        worst = max(worst, (total - lost) / total if total > 0 else 1.0)
    return worst


def measure_exposure(grey: Grey) -> tuple[float, float, float, float]:
    """Mean luminance and `highlight`, 0..1, and the shares of pixels that are black (<= 5) and white (>= 250).

    The highlight is the luminance that the brightest 2 % of the pixels exceed.
    """
    highlight = float(np.percentile(grey, HIGHLIGHT_PERCENT)) / 255
    return float(grey.mean()) / 255, highlight, float((grey <= 5).mean()), float((grey >= 250).mean())


def measure_displacement(grey_a: Grey, grey_b: Grey) -> float:
    """Motion of the picture between two images of equal size, as a share of their width; NaN when nothing is tracked.

    The 90th percentile of the displacement of tracked corners: near 0 only where nearly everything stands still.
    Corners that cannot be followed mean that the picture changed, so the result is NaN, not 0, when most are lost.
    """
    import cv2

    corners = cv2.goodFeaturesToTrack(grey_a, maxCorners=300, qualityLevel=0.01, minDistance=8)
    if corners is None or len(corners) < 10:
        return float("nan")
    moved, found, _ = cv2.calcOpticalFlowPyrLK(grey_a, grey_b, corners, None, winSize=(21, 21), maxLevel=3)
    tracked = found.ravel() == 1
    if tracked.mean() < 0.5:
        return float("nan")
    lengths = np.linalg.norm((moved - corners).reshape(-1, 2)[tracked], axis=1)
    displacement: float = float(np.percentile(lengths, 90)) / grey_a.shape[1]
    return displacement


def stands_still(displacements: tuple[float, ...]) -> bool:
    """Whether a camera never moves, from the `measure_displacement` between each image and the next."""
    known = np.array([value for value in displacements if np.isfinite(value)])
    return 2 * len(known) > len(displacements) and float(np.percentile(known, 95)) < STILL_DISPLACEMENT


def quality_flags(blur: float, highlight: float, white_share: float) -> dict[str, str]:
    """Quality flags and their warnings from the medians of a capture's images."""
    found = {}
    if blur > BLURRED:
        found["blurred"] = "the images are blurred; walk more slowly, or film with more light"
    if highlight < DARK_HIGHLIGHT:
        found["underexposed"] = "the images are dark; switch on more light"
    if white_share > BURNT_SHARE:
        found["overexposed"] = "much of the images is burnt out white; lower the exposure"
    return found


def contrast(grey: Grey) -> float:
    """Standard deviation of (H, W) grey values, of 255."""
    import cv2

    return float(cv2.meanStdDev(grey)[1].item())


def change(before: Grey | None, grey: Grey) -> float:
    """Mean absolute difference of two images of equal size, of 255; infinite if there is no image before."""
    import cv2

    return float("inf") if before is None else float(cv2.mean(cv2.absdiff(before, grey))[0])


def find_blank_and_repeated(contrasts: Float64, changes: Float64) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which of n frames show nothing, and which of the others only repeat the frame before.

    What holds for most frames is not a defect of single frames: then it is dark or the camera stands still, and the
    stage reports that instead.
    """
    blank = contrasts < BLANK_CONTRAST
    blank &= 2 * blank.sum() < len(blank)
    return blank, ~blank & (changes < REPEATED_SHARE * np.median(changes))


def spread_indices(n: int, count: int) -> list[int]:
    """At most `count` of 0..n-1, evenly spaced, the first always among them."""
    return list(range(n)) if n <= count else [i * n // count for i in range(count)]
