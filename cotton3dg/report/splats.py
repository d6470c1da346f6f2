# SPDX-License-Identifier: Apache-2.0
"""The plant's Gaussians for the page: those that images show most, in few bytes (templates/splats.js draws them)."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..core.scene import Camera, Gaussians, rotations
from ..gaussians.rasterizer import accumulate_weights
from .frame import Frame

MOST_SPLATS: Final = 40_000
"""Of plant and table together; some 0.8 MB of a page."""
JUDGING_VIEWS: Final = 12
JUDGING_WIDTH_PX: Final = 400
"""Views, and their width, in which the Gaussians are weighed against each other."""
BITS_PER_AXIS: Final = 16


def choose_splats(gaussians: Gaussians, wanted: NDArray[np.bool_], cameras: Sequence[Camera]) -> NDArray[np.int64]:
    """At most MOST_SPLATS of the wanted Gaussians: those with the largest blending weights, summed over the cameras.

    A Gaussian that no camera sees is left out. Without cameras, opaque and large ones go first.

    Args:
        wanted: (N,) the plant and what is shown around it.
    Returns:
        (S,) rows, ascending.
    """
    candidates = np.flatnonzero(wanted & gaussians.finite_rows)
    shares = np.zeros(len(gaussians))
    for camera in cameras:
        height = max(1, round(camera.height * JUDGING_WIDTH_PX / camera.width))
        no_masks = np.zeros((height, JUDGING_WIDTH_PX), np.uint16)
        shares += accumulate_weights(gaussians, camera.resized(JUDGING_WIDTH_PX, height), no_masks).total
    if not cameras:
        shares = gaussians.opacities * np.exp(2 * gaussians.log_scales.mean(axis=1))
    by_share = candidates[np.argsort(-shares[candidates], kind="stable")][:MOST_SPLATS]
    return np.sort(by_share[shares[by_share] > 0])


def pack_splats(shown: Gaussians, owners: NDArray[Any], frame: Frame) -> dict[str, Any]:
    """Gaussians as the page reads them: quantised, ordered along a space-filling curve, compressed.

    Positions have 16 bits an axis within their box, logarithms of the standard deviations 8 bits between their
    extremes, quaternions 8 bits a component, colours and opacity 8 bits. Neighbours in space are neighbours in the
    file and equal parts of all splats stand together, which saves gzip a fifth of the bytes.

    Args:
        owners: (S,) boll of each Gaussian, 0 = none.
    """
    places = frame.places(shown.means)
    to_page = frame.page_from_scene
    size = float(np.cbrt(np.linalg.det(to_page)))
    turned = Rotation.from_matrix((to_page / size) @ rotations(shown.quats)).as_quat(scalar_first=True)
    turned *= np.where(turned[:, :1] < 0, -1, 1)
    low, high = places.min(axis=0), places.max(axis=0)
    widths = np.maximum(high - low, 1e-9)
    steps = np.rint((places - low) / widths * 65535).astype(np.uint16)
    logs = shown.log_scales.astype(np.float64) + np.log(size)
    least, most = float(logs.min()), float(logs.max())
    parts = [
        steps & 255,
        steps >> 8,
        np.rint((logs - least) / max(most - least, 1e-9) * 255),
        np.rint(turned * 127) + 127,
        np.rint(np.column_stack([shown.colours, shown.opacities]) * 255),
        np.column_stack([owners & 255, owners >> 8]),
    ]
    planes = np.hstack([part.astype(np.uint8) for part in parts])[np.argsort(_along_curve(steps), kind="stable")]
    content = gzip.compress(np.ascontiguousarray(planes.T).tobytes(), 9, mtime=0)
    return {
        "n": len(shown),
        "low": low.round(5).tolist(),
        "widths": widths.round(5).tolist(),
        "log_scales": [round(least, 5), round(most, 5)],
        "gzip": base64.b64encode(content).decode("ascii"),
    }


def _along_curve(steps: NDArray[np.uint16]) -> NDArray[np.uint64]:
    """(S,) Morton codes: the bits of x, y and z in turn."""
    codes = np.zeros(len(steps), np.uint64)
    for axis in range(3):
        column = steps[:, axis].astype(np.uint64)
        for bit in range(BITS_PER_AXIS):
            codes |= ((column >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return codes
