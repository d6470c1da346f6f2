# SPDX-License-Identifier: Apache-2.0
"""How much of a thin line in space is covered by something of a known colour, from photos.

A twig that is thinner than a pixel covers a share a of the pixels that it crosses: they are a W + (1 - a) B, with W
the wood's colour and B the background's. The pixels at either side show B, so each place of a line gives, in each
photo, one equation for a. All photos together determine a although the noise and texture of each are larger than the
twig's trace.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .. import _native
from ..core.scene import Camera, Float64
from ..gaussians.rasterizer import view_of

ASIDE_PX: Final = (2.5, 3.5)
"""Distances, at either side of a line, at which the photo shows the background."""
NOISE: Final = 3.5
"""Noise of a pixel, grey levels."""
COLOUR_SHARE: Final = 0.35
"""Difference between the colours of a twig and of the wood, as a share of the contrast to the background."""
NEAREST_CM: Final = 1e-9
"""Least depth at which a photo shows a place, so that it lies in front of the camera."""


class PhotoLines:
    """Photos, each with the camera that took it and the part of it that does not count."""

    def __init__(
        self, cameras: Sequence[Camera], photos: Sequence[NDArray[np.uint8]], hidden: Sequence[NDArray[np.bool_]]
    ):
        """
        Args:
            cameras: of V photos, in the frame of the lines.
            photos: (H, W, 3) each. hidden: (H, W) each; lines that come near are not measured there.
        """
        self.pictures = [_with_mask(photo, mask) for photo, mask in zip(photos, hidden, strict=True)]
        self.cameras = cameras
        self.views = [view_of(camera, NEAREST_CM) for camera in cameras]

    def __len__(self) -> int:
        return len(self.pictures)

    def colours(self, places: Float64) -> Float64:
        """(V, 3) median colour of each photo over places (N, 3); hidden places count, too."""
        return np.array([self._colour(view, places) for view in range(len(self))])

    def evidence(self, places: Float64, directions: Float64, colours: Float64) -> tuple[Float64, Float64]:
        """Sums over colours, weighted by their variance, whose quotient is the share that is covered.

        Args:
            places, directions: (N, 3) of short pieces of lines. colours: (V, 3) of wood in each photo.
        Returns:
            of (I - B)·(W - B) and of (W - B)², (V, N) each; both are 0 where a photo does not show the place.
        """
        at, along, wood = (np.ascontiguousarray(rows, np.float64) for rows in (places, directions, colours))
        return _native.line_evidence(
            self.pictures, self.views, at, along, wood, ASIDE_PX, NOISE, COLOUR_SHARE, threads=0
        )

    def _colour(self, view: int, places: Float64) -> Float64:
        picture, pixels = self.pictures[view], self.cameras[view].project(places)[0]
        shown = pixels[((pixels >= 0) & (pixels < picture.shape[1::-1])).all(axis=1)].astype(int)
        return np.median(picture[shown[:, 1], shown[:, 0], :3], axis=0) if len(shown) else np.zeros(3)


def _with_mask(photo: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(H, W, 4) the photo, and 255 where it is hidden."""
    picture = np.empty((*mask.shape, 4), np.uint8)
    picture[..., :3] = photo
    picture[..., 3] = np.where(mask, np.uint8(255), np.uint8(0))
    return picture
