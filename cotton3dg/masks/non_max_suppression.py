# SPDX-License-Identifier: Apache-2.0
"""Divides the pixels of an image among the proposals of a network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64

SAME: Final = 0.5
"""IoU from which two masks are one object: two objects cannot both own most of their union."""
INSIDE: Final = 0.8
"""Share of a mask's pixels from which it counts as contained in another; the rest is the raggedness of its edge."""
TILE_OVERLAP: Final = 0.25
"""Share of a tile that its neighbour sees too. Anything narrower than that is whole in one of them."""


@dataclass(frozen=True)
class Candidate:
    """One proposed object."""

    top: int
    left: int
    mask: NDArray[np.bool_]
    """(h, w), tight around the object, at `top`, `left` of the image."""
    score: float
    """0..1."""


def crop(mask: NDArray[np.bool_], top: int, left: int, score: float) -> Candidate | None:
    """The candidate of a mask whose corner lies at `top`, `left`; None when the mask is empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    first, last = (rows[0], columns[0]), (rows[-1] + 1, columns[-1] + 1)
    tight = mask[first[0] : last[0], first[1] : last[1]].copy()
    return Candidate(top + int(first[0]), left + int(first[1]), tight, min(max(float(score), 0.0), 1.0))


def resolve_overlaps(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The candidates that each stand for one object, the surest first.

    Of duplicates the surest one stays. A mask that several others fill by half or more is a heap of objects and is
    removed. If any other mask contains a smaller one, the smaller one is a part of it and is removed.
    """
    kept: list[Candidate] = []
    for candidate in sorted(candidates, key=lambda item: -item.score):
        px = candidate.mask.sum()
        if all(shared < SAME * (px + other.mask.sum() - shared) for other, shared in _touching(candidate, kept)):
            kept.append(candidate)
    heaps: set[int] = set()
    parts: set[int] = set()
    for whole in sorted(kept, key=lambda item: -item.mask.sum()):
        inside = [
            (other, shared)
            for other, shared in _touching(whole, kept)
            if other is not whole and shared >= INSIDE * other.mask.sum() and other.mask.sum() < whole.mask.sum()
        ]
        if len(inside) > 1 and sum(shared for _, shared in inside) >= SAME * whole.mask.sum():
            heaps.add(id(whole))
        elif id(whole) not in parts:
            parts.update(id(other) for other, _ in inside)
    return [item for item in kept if id(item) not in heaps | parts]


def paint_candidates(
    candidates: Sequence[Candidate], height: int, width: int
) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """(H, W) ids, 1 ... from the surest on, and their scores; a pixel that several claim belongs to the surest."""
    ids, scores = np.zeros((height, width), np.uint16), {}
    ordered = sorted(candidates, key=lambda item: -item.score)[: np.iinfo(np.uint16).max]
    for number, item in reversed(list(enumerate(ordered, start=1))):
        h, w = item.mask.shape
        ids[item.top : item.top + h, item.left : item.left + w][item.mask] = number
        scores[number] = round(item.score, 4)
    return ids, {number: scores[number] for number in np.unique(ids[ids > 0]).tolist()}


def tiles(height: int, width: int, side_px: int) -> list[tuple[int, int, int, int]]:
    """Top, left, bottom, right of squares that cover an image and overlap; the whole image where `side_px` is 0."""
    if side_px <= 0:
        return [(0, 0, height, width)]
    tops, lefts = (_starts(length, side_px) for length in (height, width))
    return [(top, left, min(top + side_px, height), min(left + side_px, width)) for top in tops for left in lefts]


def cut_by_tile(box: Float64, tile: tuple[int, int, int, int], height: int, width: int) -> bool:
    """Whether a box (left, top, right, bottom; px of the image) ends at a border of the tile within the image."""
    top, left, bottom, right = tile
    margin = 2
    return bool(
        (left > 0 and box[0] < left + margin)
        or (top > 0 and box[1] < top + margin)
        or (right < width and box[2] > right - margin)
        or (bottom < height and box[3] > bottom - margin)
    )


def _starts(length: int, side: int) -> list[int]:
    if length <= side:
        return [0]
    count = int(np.ceil((length - side) / (side * (1 - TILE_OVERLAP)))) + 1
    starts: list[int] = np.round(np.linspace(0, length - side, count)).astype(int).tolist()
    return starts


def _touching(one: Candidate, others: Sequence[Candidate]) -> list[tuple[Candidate, int]]:
    """Those of `others` that share pixels with one, and how many."""
    found = []
    for other in others:
        top, left = max(one.top, other.top), max(one.left, other.left)
        bottom = min(one.top + one.mask.shape[0], other.top + other.mask.shape[0])
        right = min(one.left + one.mask.shape[1], other.left + other.mask.shape[1])
        if top < bottom and left < right:
            views = [i.mask[top - i.top : bottom - i.top, left - i.left : right - i.left] for i in (one, other)]
            if shared := int((views[0] & views[1]).sum()):
                found.append((other, shared))
    return found
