# SPDX-License-Identifier: Apache-2.0
"""The first half of structure from motion on a film: some frames, evenly spaced, with their features, matches, cameras.

They show how good a film is in less than half of the time that all frames take, and no part of this work is done twice.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from ..core.libraries import import_pycolmap
from ..io.arrays import read_arrays
from .features import Features
from .matching import PairMatches

KEYFRAMES: Final = 30
"""Least number of a film's images, evenly spaced, that are placed one after the other, each with an adjustment of its
neighbours. The points of these then place the other images, and all are adjusted together."""
UNUSUAL_SHARE: Final = 0.4
"""Where neighbouring keyframes have fewer matches than this share of the film's usual number, the images between them
become keyframes, too; ..."""
TOO_LITTLE_IN_COMMON: Final = (100, 200)
"""... but always where they have fewer than the first, and never where they have more than the second. (A walk of
uneven pace fell apart where 120 to 140 were left of 660, one in a bare room where 54 to 70 were left of 90.)"""
LEAST_PLACED: Final = 0.95
"""Share of the keyframes, and then of all images, below which all are placed one after the other."""
MODEL: Final = "model"
FEATURES: Final = "features.npz"
MATCHES: Final = "matches.npz"


@dataclass(frozen=True)
class Keyframes:
    """The features, matches and cameras of the keyframes; images are numbers in the list of all names."""

    images: tuple[int, ...]
    features: dict[int, Features]
    matches: dict[tuple[int, int], PairMatches]
    """Matches of the pairs that fit together."""
    folder: Path
    """Its `model/` is the COLMAP model with the most images; missing when no two images fit together."""

    def read_model(self) -> Any | None:
        """A pycolmap.Reconstruction. It is always read from the disk, wherever the keyframes were placed, because the
        order of its points there decides the last bits of every later result."""
        pycolmap = import_pycolmap()

        return pycolmap.Reconstruction(self.folder / MODEL) if (self.folder / MODEL).is_dir() else None

    def save(self) -> None:
        """Write features and matches beside the model."""
        found = {f"{i}.{name}": getattr(self.features[i], name) for i in self.images for name in _OF_IMAGE}
        pairs = {f"{i}-{j}.{name}": getattr(pair, name) for (i, j), pair in self.matches.items() for name in _OF_PAIR}
        np.savez(self.folder / FEATURES, images=np.array(self.images), **found)
        np.savez(self.folder / MATCHES, **pairs)

    @classmethod
    def load(cls, folder: Path) -> Self:
        """The keyframes that `save` wrote.

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


_OF_IMAGE: Final = ("places_px", "descriptors")
_OF_PAIR: Final = ("fundamental", "rows")


def keyframe_spacing(images: int) -> int:
    """The number n for which every n-th image of a film is a keyframe."""
    return max(1, images // KEYFRAMES)


def first_keyframes(images: int) -> list[int]:
    """Every few images, and the last one, so that they show how far a film goes around the plant."""
    return sorted({*range(0, images, keyframe_spacing(images)), images - 1})


def pairs_of_keyframes(
    chosen: Sequence[int], new: Collection[int], pairs: Sequence[tuple[int, int]]
) -> list[tuple[int, int]]:
    """The pairs with two chosen images, at least one of them new; neighbours, and their neighbours, are always matched.

    Args:
        chosen: in order of time.
        pairs: of all images.
    """
    near = [*pairwise(chosen), *zip(chosen, chosen[2:], strict=False)]
    both = set(near) | {(i, j) for i, j in pairs if i in chosen and j in chosen}
    return sorted(pair for pair in both if pair[0] in new or pair[1] in new)


def images_between(chosen: Sequence[int], matches: Mapping[tuple[int, int], PairMatches]) -> list[int]:
    """The images between those neighbours among the chosen ones, in order of time, that have too little in common."""
    common = {pair: len(matches[pair].rows) if pair in matches else 0 for pair in pairwise(chosen)}
    usual = float(np.median(list(common.values()))) if common else 0.0
    limit = np.clip(UNUSUAL_SHARE * usual, *TOO_LITTLE_IN_COMMON)
    return [image for pair, n in common.items() if n < limit for image in range(pair[0] + 1, pair[1])]


def has_enough_images(model: Any | None, images: int) -> bool:
    """Whether a model has nearly all of the images that it should have."""
    return model is not None and model.num_reg_images() >= LEAST_PLACED * images
