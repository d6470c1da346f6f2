# SPDX-License-Identifier: Apache-2.0
"""A photo together with the camera that took it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera

T = TypeVar("T")


@dataclass(frozen=True)
class View:
    """A photo and its camera, of the same size."""

    camera: Camera
    image: NDArray[np.uint8]
    """(H, W, 3) RGB."""

    def __post_init__(self) -> None:
        expected = (self.camera.height, self.camera.width, 3)
        if self.image.shape != expected or self.image.dtype != np.uint8:
            raise ValueError(f"{self.camera.name} must be uint8 {expected}, got {self.image.dtype} {self.image.shape}")

    def limited(self, side_px: float) -> View:
        """The view with its longer side brought down to `side_px`, each pixel the mean of those it covers."""
        import cv2

        factor = side_px / max(self.camera.width, self.camera.height)
        if factor >= 1:
            return self
        size = max(1, round(self.camera.width * factor)), max(1, round(self.camera.height * factor))
        return View(self.camera.resized(*size), cv2.resize(self.image, size, interpolation=cv2.INTER_AREA))


def hold_out(views: list[T], every: int) -> tuple[list[T], list[T]]:
    """Training and held-out views: every `every`-th from the first is held out, none for 0 or if none would be left.

    Also for a list of something that belongs to the views, one each.
    """
    held_out = views[::every] if every > 1 else []
    return [view for i, view in enumerate(views) if every <= 1 or i % every], held_out
