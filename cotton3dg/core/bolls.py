# SPDX-License-Identifier: Apache-2.0
"""Bolls on their way from pixels to instances: masks, selections, instances."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class LeftOut:
    """Something that looks like lint and does not count as a boll, though it may be one."""

    centre_su: tuple[float, ...]
    """(3,)."""
    diameter_su: float
    reason: str
    """`faint`: few views take it for lint; `white_thing`: no plant is beside it, and it looks less like lint."""
    probability: float
    """Of a boll, 0..1."""


@dataclass(frozen=True)
class MaskSet:
    """Boll masks of several images; the same id in two images does not mean the same boll."""

    ids: dict[str, NDArray[np.uint16]]
    """Image name -> (H, W) instance ids, 0 = background, at the size of the undistorted image."""
    scores: dict[str, dict[int, float]] = field(default_factory=dict)
    """Image name -> instance id -> confidence in 0..1."""
    notes: tuple[str, ...] = ()
    """Notes on masks that were changed when they were read from a file."""


@dataclass(frozen=True)
class BollSelection:
    """The Gaussians that one mask of one view selects."""

    view: str
    mask_id: int
    indices: NDArray[np.int64]
    """(n,) ascending Gaussian indices."""
    weights: NDArray[np.float32]
    """(n,) blending weight of each Gaussian inside the mask, summed over its pixels, px."""


@dataclass(frozen=True)
class LiftedMasks:
    """The masks of all views, lifted onto the Gaussians; `segment` hands them to `cluster`."""

    gaussians_sha256: str
    """`Gaussians.sha256()` of the model the rows belong to."""
    views: tuple[str, ...]
    """V image names, ascending."""
    candidates: NDArray[np.int64]
    """(F,) ascending indices of the Gaussians that may belong to a boll."""
    foreground: NDArray[np.float32]
    """(F,) share of each candidate's weight that lies inside masks, 0..1, over all views."""
    seen: NDArray[np.float32]
    """(V, F) blending weight of each candidate over the pixels of a view that are clearly in or out of a mask, px."""
    selections: tuple[BollSelection, ...]
    """One per mask, ascending by (view, mask id); their indices are candidates."""


@dataclass(frozen=True)
class BollInstance:
    """One boll of the plant: Gaussians on which several views agree."""

    boll_id: int
    """1, 2, ... from the top of the plant downwards where an up axis is known, else by size."""
    indices: NDArray[np.int64]
    """(n,) ascending Gaussian indices."""
    views: tuple[str, ...]
    """Images whose masks show it."""
    centre: NDArray[np.float64]
    """(3,) su."""
    diameter_su: float
    """Mean width of its Gaussians' centres; the surface lies outside of them."""
    confidence: float
    """0..1, the probability that it is one boll by the votes of all views; from masks of single images, the share of
    the views that see the boll and agree on it."""
    flags: tuple[str, ...] = ()
    masks: tuple[tuple[str, int], ...] = ()
    """(view, mask id) of each mask that shows it; a mask of touching bolls belongs only to the one that fills most of
    it."""
