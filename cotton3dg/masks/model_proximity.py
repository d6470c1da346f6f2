"""For each pixel, whether it shows something near the lint, and which boll; a white wall looks alike, but is far.

A trained model knows how far things are. Its Gaussians are near or far. Rendered with that and with their places as
values, they give each pixel the share of its light that comes from near things, and the mean place of these.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float32, Gaussians
from ..gaussians import rasterizer
from .voxel_voting import LintVolume


class ModelProximity:
    """A model whose Gaussians near the bolls of a volume are marked."""

    def __init__(self, gaussians: Gaussians, volume: LintVolume, reach: float):
        """
        Args:
            reach: distance from the volume within which a Gaussian is near, voxels.
        """
        from scipy.spatial import cKDTree

        self._tree, self._bolls = cKDTree(volume.centres), volume.bolls
        self._middle = volume.centres.mean(axis=0)
        self._gaussians = gaussians
        finite = np.isfinite(gaussians.means).all(axis=1)
        near = np.zeros(len(gaussians), bool)
        near[finite] = np.isfinite(
            self._tree.query(gaussians.means[finite], distance_upper_bound=reach * volume.pitch)[0]
        )
        # Relative to the middle, where single precision is finest.
        places = np.where(near[:, None], gaussians.means - self._middle, 0)
        self._values = np.column_stack([near, places]).astype(np.float32)

    def seen(self, camera: Camera) -> tuple[Float32, Float32]:
        """Shares (H, W), 0..1, of near things, and their mean places (H, W, 3), su; the middle if nothing is near."""
        values = rasterizer.render_values(self._gaussians, camera, self._values).image
        shares = values[..., 0]
        return shares, values[..., 1:] / np.maximum(shares, 1e-6)[..., None] + self._middle

    def bolls(self, places: Float32) -> NDArray[np.int32]:
        """(n,) the boll that each of the places (n, 3) is nearest to."""
        nearest: NDArray[np.int32] = self._bolls[self._tree.query(places)[1]]
        return nearest
