"""The first half of structure from motion on a film: some frames, evenly spaced, with their features, matches, cameras.

They tell how good a film is in less than half of the time that all frames take, and nothing of them is done twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..files.arrays import read_arrays
from .features import Features
from .matching import PairMatches

KEYFRAMES = 50
"""Of a film so many images, evenly spaced, are placed one after the other, each with an adjustment of its neighbours;
the others are then placed by the points that these have given, and all are adjusted together."""
LEAST_PLACED = 0.95
"""Share of the keyframes, and then of all images, below which all are placed one after the other."""
MODEL = "model"
FEATURES, MATCHES = "features.npz", "matches.npz"


@dataclass(frozen=True)
class Keyframes:
    """What was found of the keyframes; images are numbers in the list of all names."""

    images: tuple[int, ...]
    features: dict[int, Features]
    matches: dict[tuple[int, int], PairMatches]
    """Of the pairs that fit together."""
    folder: Path
    """Its `model/` is the COLMAP model with the most images; missing when no two images fit together."""

    def read_model(self) -> Any | None:
        """A pycolmap.Reconstruction. It is always read from the disk, whoever placed the keyframes, because the order
        of its points there decides the last bits of what is built upon it."""
        import pycolmap

        return pycolmap.Reconstruction(self.folder / MODEL) if (self.folder / MODEL).is_dir() else None

    def save(self) -> None:
        """Write features and matches beside the model."""
        found = {f"{i}.{name}": getattr(self.features[i], name) for i in self.images for name in _OF_IMAGE}
        pairs = {f"{i}-{j}.{name}": getattr(pair, name) for (i, j), pair in self.matches.items() for name in _OF_PAIR}
        np.savez(self.folder / FEATURES, images=np.array(self.images), **found)
        np.savez(self.folder / MATCHES, **pairs)

    @classmethod
    def load(cls, folder: Path) -> Self:
        """What `save` wrote.

        Raises:
            BadInput: it is damaged.
        """
        features, matches = read_arrays(folder / FEATURES), read_arrays(folder / MATCHES)
        images = tuple(int(i) for i in features["images"])
        pairs = sorted({tuple(map(int, key.split(".")[0].split("-"))) for key in matches})
        return cls(
            images,
            {i: Features(*(features[f"{i}.{name}"] for name in _OF_IMAGE)) for i in images},
            {(i, j): PairMatches(*(matches[f"{i}-{j}.{name}"] for name in _OF_PAIR)) for i, j in pairs},
            folder,
        )


_OF_IMAGE = ("places_px", "descriptors")
_OF_PAIR = ("fundamental", "rows")


def keyframe_spacing(images: int) -> int:
    """Every how many-th image of a film is a keyframe."""
    return max(1, round(images / KEYFRAMES))


def will_do(model: Any | None, images: int) -> bool:
    """Whether a model has nearly all of the images that it was to have."""
    return model is not None and model.num_reg_images() >= LEAST_PLACED * images
