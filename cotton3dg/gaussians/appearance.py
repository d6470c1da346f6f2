# SPDX-License-Identifier: Apache-2.0
"""Ways to show a model other than as filmed: its bolls in colours, or how far away things are."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import SH_CONSTANT, Float32, Gaussians

FADED: Final = 0.35
"""Share of its contrast that everything except the bolls keeps."""


def boll_colours(labels: NDArray[np.int32]) -> Float32:
    """(N, 3) RGB: hues a golden angle apart, so that neighbours in number differ; no boll is grey."""
    hue = (labels * 0.618034) % 1.0
    ramps = np.abs((hue[:, None] * 6 + np.array([0.0, 4.0, 2.0])) % 6 - 3) - 1
    return np.where(labels[:, None] > 0, np.clip(ramps, 0.1, 0.95), 0.35).astype(np.float32)


def recolour_bolls(gaussians: Gaussians, labels: NDArray[np.int32], background: float) -> Gaussians:
    """Each boll in a colour of its own and everything else faded towards the grey level of the background, 0..1.

    Args:
        labels: (N,) boll of each Gaussian, 0 = none.
    """
    sh = gaussians.sh * np.float32(FADED)
    sh[:, 0] += np.float32((1 - FADED) * (background - 0.5) / SH_CONSTANT)
    bolls = labels > 0
    sh[bolls] = 0
    sh[bolls, 0] = (boll_colours(labels[bolls]) - 0.5) / SH_CONSTANT
    return Gaussians(gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacity_logits, sh)


def depth_colours(
    depth: Float32, transmittance: Float32, near_su: float, far_su: float, background: float
) -> NDArray[np.float64]:
    """(H, W, 3) RGB of a rendered depth: red at `near_su` or nearer, through green to blue at `far_su` or farther.

    The colour map is Turbo (Mikhailov 2019). Where the background shows through it is mixed in.
    """
    import cv2

    nearness = np.clip((far_su - depth) / (far_su - near_su), 0.0, 1.0)
    bgr = cv2.applyColorMap(np.rint(nearness * 255).astype(np.uint8), cv2.COLORMAP_TURBO)
    colours: NDArray[np.float64] = (
        bgr[..., ::-1] / 255.0 * (1 - transmittance[..., None]) + background * transmittance[..., None]
    )
    return colours
