"""What photos show along a thin line in space: how much of it something of a known colour covers.

A twig that is thinner than a pixel covers a share a of the pixels that it crosses: they are a W + (1 - a) B, with W
the wood's colour and B what is behind. B is what the pixels at either side show, so each place of a line has, in each
photo, one equation for a; all photos together tell it although each one's noise and texture are larger than the twig's
trace.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float64

ASIDE_PX = (2.5, 3.5)
"""Where, at either side of a line, the photo shows what is behind."""
NOISE = 3.5
"""Of a pixel, grey levels."""
COLOUR_SHARE = 0.35
"""By how much of its contrast to what is behind a twig's colour may differ from the wood's."""
OUTSIDE = (0, 0, 0, 255)
"""What lies beyond a photo's rim: no colour, and hidden."""
MOST_PLACES = 32000
"""That OpenCV looks up in one go."""


class PhotoLines:
    """Photos, each with the camera that took it and what of it is not to be looked at."""

    def __init__(
        self, cameras: Sequence[Camera], photos: Sequence[NDArray[np.uint8]], hidden: Sequence[NDArray[np.bool_]]
    ):
        """
        Args:
            cameras: of V photos, in the frame that lines will be given in.
            photos: (H, W, 3) each. hidden: (H, W) each; lines that come near are not judged there.
        """
        self.pictures = [_with_mask(photo, mask) for photo, mask in zip(photos, hidden, strict=True)]
        self.poses = np.stack([camera.cam_from_scene for camera in cameras])
        self.focal = np.array([(camera.fx, camera.fy) for camera in cameras])[:, None]
        self.middle = np.array([(camera.cx, camera.cy) for camera in cameras])[:, None]

    def __len__(self) -> int:
        return len(self.pictures)

    def colours(self, places: NDArray) -> Float64:
        """(V, 3) what each photo shows at places (N, 3), in the median over them; hidden ones are as good as others."""
        pixels, _, _ = self._project(places, np.ones_like(places))
        return np.array([np.median(self._look(v, pixels[v])[:, :3], axis=0) for v in range(len(self))])

    def evidence(self, places: NDArray, directions: NDArray, colours: NDArray) -> tuple[Float64, Float64]:
        """Sums over colours, weighted by their variance, whose quotient is the share that is covered.

        Args:
            places, directions: (N, 3) of short pieces of lines. colours: (V, 3) of wood in each photo.
        Returns:
            of (I - B)·(W - B) and of (W - B)², (V, N) each; both are 0 where a photo does not show the place.
        """
        pixels, across, ahead = self._project(places, directions)
        offsets = np.array([0.0, *ASIDE_PX, *(-aside for aside in ASIDE_PX)])
        above, below = np.zeros(pixels.shape[:2]), np.zeros(pixels.shape[:2])
        # Short axes come first: sums over them are then sums of long arrays.
        for view in range(len(self)):
            wanted = pixels[view] + offsets[:, None, None] * across[view]
            seen = self._look(view, wanted.reshape(-1, 2)).reshape(len(offsets), len(places), 4)
            clear = ahead[view] & (seen[..., 3] == 0).all(axis=0)
            aside = seen[1:, :, :3]
            behind = aside.mean(axis=0)
            texture = np.abs(aside - behind).mean(axis=0).mean(axis=1)
            shown, contrast = seen[0, :, :3] - behind, colours[view] - behind
            power = np.einsum("nc,nc->n", contrast, contrast)
            weight = clear / (NOISE**2 + texture**2 + COLOUR_SHARE**2 * power / 3)
            above[view], below[view] = weight * np.einsum("nc,nc->n", shown, contrast), weight * power
        return above, below

    def _project(self, places: NDArray, directions: NDArray) -> tuple[Float64, Float64, NDArray[np.bool_]]:
        """Pixels (V, N, 2), as OpenCV counts them; unit vectors (V, N, 2) across the lines there; (V, N) whether before
        the camera."""
        turned = np.swapaxes(self.poses[:, :, :3], 1, 2)
        points = places @ turned + self.poses[:, None, :, 3]
        along = directions @ turned
        depths = points[..., 2:]
        ahead = depths[..., 0] > 0
        depths = np.where(ahead[..., None], depths, 1.0)
        plane = points[..., :2] / depths
        tangents = (along[..., :2] - plane * along[..., 2:]) * self.focal
        tangents = tangents / np.maximum(np.linalg.norm(tangents, axis=-1, keepdims=True), 1e-12)
        across = np.stack([-tangents[..., 1], tangents[..., 0]], axis=-1)
        return plane * self.focal + self.middle - 0.5, across, ahead

    def _look(self, view: int, pixels: NDArray) -> NDArray[np.float64]:
        """(N, 4) colour and, where it is hidden or outside of the photo, more than 0."""
        import cv2

        # OpenCV's own coordinates are 16 bits wide.
        x, y = np.clip(pixels, -9.0, 32000.0).astype(np.float32).T
        picture, edge = self.pictures[view], cv2.BORDER_CONSTANT
        parts = [slice(at, at + MOST_PLACES) for at in range(0, len(x), MOST_PLACES)]
        rows = [
            cv2.remap(picture, x[part, None], y[part, None], cv2.INTER_LINEAR, None, edge, OUTSIDE) for part in parts
        ]
        return np.concatenate(rows).reshape(-1, 4).astype(np.float64)


def _with_mask(photo: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(H, W, 4) the photo, and 255 where it is hidden."""
    picture = np.empty((*mask.shape, 4), np.uint8)
    picture[..., :3] = photo
    picture[..., 3] = np.where(mask, np.uint8(255), np.uint8(0))
    return picture
