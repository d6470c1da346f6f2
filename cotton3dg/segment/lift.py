# SPDX-License-Identifier: Apache-2.0
"""Lifts masks of bolls onto Gaussians: how much of each Gaussian's weight falls into which mask.

Rendering is linear in the Gaussians' values, so one forward pass a view gives each Gaussian's weight, in pixels, inside
every mask. A vote over the views then does not need an optimisation. Idea: FlashSplat (Shen et al. 2024), Eq. 5-7.
Departures: a rim around mask edges counts neither for nor against a mask, because detectors and depth discontinuities
disagree there; identities are not taken from the masks, the stage cluster finds them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import BollSelection, LiftedMasks
from ..core.scene import Float32

RIM_ID: Final = 65535
"""Mask id of the pixels that count neither for nor against a mask."""
FOREGROUND_SHARE: Final = 0.25
"""Least share of a candidate's weight inside masks. A boll that every third view finds is a candidate; the stem, which
masks cover here and there, is not. A later vote decides on each boll's Gaussians, at one half."""
LEAST_WEIGHT_PX: Final = 0.05
"""Least weight of a Gaussian in some view. Others are invisible: hidden inside, or far below one grey level."""


class ViewWeights(NamedTuple):
    """Blending weights of one view, as `gaussians.rasterizer.accumulate_weights` gives them."""

    view: str
    total: NDArray[np.float32]
    """(N,) px, over all pixels."""
    rows: NDArray[np.int64]
    """(P,) Gaussians, ascending; with `ids` and `weights` the non-zero entries of a Gaussian x mask table."""
    ids: NDArray[np.uint16]
    """(P,) mask ids, `RIM_ID` for the rim."""
    weights: NDArray[np.float32]
    """(P,) px."""


def resize_ids(ids: NDArray[np.uint16], width: int, height: int) -> NDArray[np.uint16]:
    """Instance ids at width x height by the nearest pixel centre."""
    rows = ((np.arange(height) + 0.5) * ids.shape[0] / height).astype(np.int64)
    columns = ((np.arange(width) + 0.5) * ids.shape[1] / width).astype(np.int64)
    return np.ascontiguousarray(ids[rows[:, None], columns])


def rim_width_px(id_images: Iterable[NDArray[np.uint16]]) -> int:
    """Width of the rim to ignore: 5 % of the median mask's diameter, 1 to 3 px; 1 without masks."""
    areas = [np.bincount(ids.ravel())[1:] for ids in id_images]
    sizes = np.concatenate(areas) if areas else np.zeros(0)
    sizes = sizes[sizes > 0]
    if not len(sizes):
        return 1
    return int(np.clip(round(0.05 * 2 * np.sqrt(float(np.median(sizes)) / np.pi)), 1, 3))


def mark_rim(ids: NDArray[np.uint16], width_px: int) -> NDArray[np.uint16]:
    """The ids with `RIM_ID` wherever another id lies within `width_px`, on either side of an edge."""
    rim = np.zeros(ids.shape, bool)
    for shift in range(1, width_px + 1):
        across, down = ids[:, shift:] != ids[:, :-shift], ids[shift:] != ids[:-shift]
        rim[:, shift:] |= across
        rim[:, :-shift] |= across
        rim[shift:] |= down
        rim[:-shift] |= down
    return np.where(rim, np.uint16(RIM_ID), ids)


def sum_seen_weights(views: Sequence[ViewWeights], n: int) -> Float32:
    """(V, N) blending weight of each of n Gaussians over the pixels of a view that are clearly in or out of a mask."""
    seen = np.zeros((len(views), n), np.float32)
    for row, view in enumerate(views):
        rim = view.ids == RIM_ID
        seen[row] = view.total
        # A pair occurs once in a view, so plain indexing adds correctly.
        seen[row, view.rows[rim]] -= view.weights[rim]
    return np.maximum(seen, 0, out=seen)


def vote_foreground(views: Sequence[ViewWeights], seen: Float32) -> NDArray[np.float64]:
    """(N,) share, 0..1, of each Gaussian's weight that lies inside masks; `seen` as `sum_seen_weights` gives it."""
    held = np.zeros(seen.shape[1])
    for view in views:
        inside = view.ids != RIM_ID
        held += np.bincount(view.rows[inside], view.weights[inside], len(held))
    shares: NDArray[np.float64] = np.minimum(held / np.maximum(seen.sum(axis=0, dtype=np.float64), 1e-12), 1.0)
    return shares


def lift(
    views: Iterable[ViewWeights],
    allowed: NDArray[np.bool_],
    gaussians_sha256: str,
    foreground: NDArray[Any] | None = None,
    least_foreground: float = FOREGROUND_SHARE,
) -> LiftedMasks:
    """Collect the views' weights into one selection of Gaussians a mask.

    Args:
        views: one entry a view, in any order.
        allowed: (N,) Gaussians that may belong to a boll at all.
        gaussians_sha256: of the model that was rendered.
        foreground: (N,) 0..1, how likely each Gaussian is lint; None = `vote_foreground`.
        least_foreground: least value of it for a candidate.
    Returns:
        candidates, their weights in each view, and a selection for every mask that holds one; without any mask all are
        empty.
    """
    ordered = sorted(views, key=lambda view: view.view)
    seen = sum_seen_weights(ordered, len(allowed))
    if foreground is None:
        foreground = vote_foreground(ordered, seen)
    chosen = allowed & (foreground >= least_foreground) & (seen.max(axis=0, initial=0) >= LEAST_WEIGHT_PX)
    selections = []
    for view in ordered:
        keep = (view.ids != RIM_ID) & (view.ids > 0) & chosen[view.rows]
        rows, ids, weights = view.rows[keep], view.ids[keep], view.weights[keep]
        order = np.lexsort((rows, ids))
        names, starts = np.unique(ids[order], return_index=True)
        for name, part in zip(names, np.split(order, starts[1:]), strict=False):
            selections.append(BollSelection(view.view, int(name), rows[part], weights[part]))
    candidates = np.flatnonzero(chosen)
    return LiftedMasks(
        gaussians_sha256,
        tuple(view.view for view in ordered),
        candidates,
        foreground[candidates].astype(np.float32),
        np.ascontiguousarray(seen[:, candidates]),
        tuple(selections),
    )
