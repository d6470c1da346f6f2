"""masks/masks.json: how the masks were made, and how many each image has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..core.bolls import LeftOut
from .document import Document


@dataclass(frozen=True)
class MaskedImage:
    """One image with masks, or with none."""

    name: str
    instances: int
    scores: dict[str, float]
    """Mask id -> confidence in 0..1, where the back end gives one."""


@dataclass(frozen=True)
class MasksInfo(Document):
    """The masks that the stage masks made."""

    REMEDY = "run `cotton3dg masks --force`"

    backend: str
    options: dict[str, Any]
    weights_sha256: dict[str, str]
    seconds_per_image: float
    images: tuple[MaskedImage, ...]
    together: bool = False
    """Whether all images decided together, so that a score is the probability of one boll."""
    halves: tuple[int, int] | None = None
    """Counts of bolls by every second image alone, and by the others."""
    left_out: tuple[LeftOut, ...] = ()
    """What all images together saw and left out."""

    def scores(self) -> dict[tuple[str, int], float]:
        """By image and mask id."""
        return {(image.name, int(mask)): score for image in self.images for mask, score in image.scores.items()}
