# SPDX-License-Identifier: Apache-2.0
"""A model with how much each of its Gaussians is lint, and how views see that."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float32, Gaussians
from ..gaussians import rasterizer


@dataclass(frozen=True)
class LintInSpace:
    """A trained model with how much each of its Gaussians is lint."""

    gaussians: Gaussians
    shares: Float32
    """(N,) 0..1"""
    origin: Float32
    """(3,) su, amid the lint: places are rendered relative to it, where single precision is finest."""

    @classmethod
    def of(cls, gaussians: Gaussians, shares: Float32) -> LintInSpace:
        """With the origin at the median of what is lint."""
        lint = cls(gaussians, shares, np.zeros(3, np.float32))
        places = gaussians.means[lint.rows]
        return replace(lint, origin=np.median(places, axis=0).astype(np.float32)) if len(places) else lint

    @property
    def rows(self) -> NDArray[np.int64]:
        """(L,) the Gaussians that are lint."""
        return np.flatnonzero((self.shares > 0.5) & np.isfinite(self.gaussians.means).all(axis=1))

    def seen(self, camera: Camera) -> tuple[Float32, Float32]:
        """Share of lint in each pixel (H, W), 0..1, and the mean place of that lint (H, W, 3), su; origin without."""
        local = self.gaussians.means - self.origin
        local[~np.isfinite(local)] = 0
        values = np.column_stack([self.shares, self.shares[:, None] * local]).astype(np.float32)
        image = rasterizer.render_values(self.gaussians, camera, values).image
        share = image[..., 0]
        places = image[..., 1:] / np.maximum(share, np.float32(1e-6))[..., None] + self.origin
        return share, places.astype(np.float32)
