"""Which masks show which boll, once it is known which Gaussians are its."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import BollInstance, LiftedMasks

OTHER_WEIGHT = 0.5
"""A boll has a mask when it holds more than this many times the weight there of what is no boll."""


def assign_masks(bolls: Sequence[BollInstance], lifted: LiftedMasks, labels: NDArray[np.int32]) -> list[BollInstance]:
    """The same bolls with their masks: those in which none has more weight. A mask of no boll is nobody's.

    Args:
        labels: (N,) boll of each Gaussian, 0 = none.
    """
    masks: dict[int, list[tuple[str, int]]] = {}
    for selection in lifted.selections:
        held = np.bincount(labels[selection.indices], weights=selection.weights, minlength=2)
        if held[1:].max() > OTHER_WEIGHT * held[0]:
            masks.setdefault(int(held[1:].argmax()) + 1, []).append((selection.view, selection.mask_id))
    return [replace(boll, masks=tuple(masks.get(boll.boll_id, ()))) for boll in bolls]
