# SPDX-License-Identifier: Apache-2.0
"""masks/masks.json: how the masks were made, and how many each image has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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
    maps: bool = False
    """Whether the network's maps of each image are there, too: `masks/<image>.npz`."""
