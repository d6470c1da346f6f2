"""Which masks show which boll, once its Gaussians are known, and the scores of these masks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import BollInstance, LiftedMasks

OTHER_WEIGHT: Final = 0.5
"""A mask belongs to a boll whose weight in it is more than this many times the weight of all that is not a boll."""


def assign_masks(bolls: Sequence[BollInstance], lifted: LiftedMasks, labels: NDArray[np.int32]) -> list[BollInstance]:
    """The same bolls with their masks: those in which no other boll has more weight. Some masks belong to no boll.

    Args:
        labels: (N,) boll of each Gaussian, 0 = none.
    """
    masks: dict[int, list[tuple[str, int]]] = {}
    for selection in lifted.selections:
        held = np.bincount(labels[selection.indices], weights=selection.weights, minlength=2)
        if held[1:].max() > OTHER_WEIGHT * held[0]:
            masks.setdefault(int(held[1:].argmax()) + 1, []).append((selection.view, selection.mask_id))
    return [replace(boll, masks=tuple(masks.get(boll.boll_id, ()))) for boll in bolls]


def weigh_scores(bolls: Sequence[BollInstance], scores: Mapping[tuple[str, int], float]) -> list[BollInstance]:
    """The same bolls with the probability that each is one boll, for masks that all images made together.

    All masks of a boll then agree, so the number of agreeing views is not evidence.

    Args:
        scores: by (view, mask id), the probability that the mask shows one boll.
    """
    return [_weigh(boll, [scores[mask] for mask in boll.masks if mask in scores]) for boll in bolls]


def _weigh(boll: BollInstance, scores: Sequence[float]) -> BollInstance:
    if not scores:
        return boll
    confidence = boll.confidence * float(np.mean(scores))
    doubts = ("disputed",) if confidence < 0.5 and "disputed" not in boll.flags else ()
    return replace(boll, confidence=confidence, flags=(*boll.flags, *doubts))
