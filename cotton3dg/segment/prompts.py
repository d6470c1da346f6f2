# SPDX-License-Identifier: Apache-2.0
"""From affinity features and the masks of a few views to one set of Gaussians a mask (Cotton3DGaussians, Eq. 11).

A mask is a prompt: its query is the mean of the rendered features in it, and Gaussians similar to the query are its
boll. Departures: similarity alone cannot separate two bolls that no view shows together, because nothing pushes their
features apart. So a set starts from the Gaussians that have most of their weight in the mask and grows over close
neighbours within a ball. The least similarity is 0.75 or, if that is more, the value that 90 % of the mask's own
Gaussians reach (the features of pixels agree far better than those of the Gaussians behind them, and cannot set it).
Sets of fewer than 10 Gaussians, and those whose convex hull is far larger than the others', are dropped (the paper's
cap of 25,000 has no unit).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..core.bolls import BollSelection, LiftedMasks
from ..core.scene import Camera, Float32, Gaussians
from ..geometry.convex_measures import convex_volume
from ..geometry.point_sets import MIN_GAUSSIANS, measure_extent
from .affinity import find_heaviest_weights
from .lift import LEAST_WEIGHT_PX, RIM_ID, ViewWeights

LEAST_SIMILARITY: Final = 0.75
FAINT: Final = 0.1
"""Fainter Gaussians belong to no boll."""
EDGE_SPACINGS: Final = 3.0
"""Longest step of growing, in median spacings of the seeds."""
BALL: Final = 1.5
"""Diameter of the ball in which a set stays, relative to the diameter of its seeds, which are the visible side of the
boll."""
VOLUME_CAP: Final = 3.0
"""Largest hull, relative to the median of all."""


class PromptView(NamedTuple):
    """A view whose masks are prompts."""

    camera: Camera
    ids: NDArray[np.uint16]
    """(H, W), 0 = background."""
    weights: ViewWeights
    """Accumulated over `ids` without a rim."""


def lift_prompts(
    gaussians: Gaussians, smooth_features: Float32, views: Sequence[PromptView], allowed: NDArray[np.bool_], sha256: str
) -> tuple[LiftedMasks, dict[str, int]]:
    """The Gaussians of every mask of the given views.

    Args:
        smooth_features: (N, C), zero where there is none.
        allowed: (N,) Gaussians that may belong to a boll at all.
        sha256: of the Gaussians.
    Returns:
        the sets as selections of their views, and how many masks gave none, by reason. A Gaussian in a set whose view
        hides it has the weight LEAST_WEIGHT_PX there.
    """
    lengths = np.linalg.norm(smooth_features, axis=1, keepdims=True)
    unit = np.divide(smooth_features, lengths, out=np.zeros_like(smooth_features), where=lengths > 1e-6)
    usable = allowed & (gaussians.opacities >= FAINT) & (lengths[:, 0] > 1e-6)
    ordered = sorted(views, key=lambda view: view.camera.name)
    sets: list[tuple[int, int, NDArray[np.int64], float]] = []
    best = np.zeros(len(gaussians), np.float32)
    for v, view in enumerate(ordered):
        rendered = _render_inner_features(gaussians, unit, view)
        for mask_id, inside in rendered.items():
            similarity = unit @ _normalise(inside.mean(axis=0))
            held = view.weights.rows[view.weights.ids == mask_id]
            share = view.weights.weights[view.weights.ids == mask_id] / np.maximum(view.weights.total[held], 1e-12)
            held = held[(share >= 0.5) & (view.weights.total[held] >= LEAST_WEIGHT_PX) & usable[held]]
            lowest = float(np.percentile(similarity[held], 10)) if len(held) else 1.0
            alike = usable & (similarity >= max(LEAST_SIMILARITY, lowest))
            seeds = held[alike[held]]
            rows = grow(gaussians.means, seeds, alike) if len(seeds) >= MIN_GAUSSIANS else seeds
            volume = convex_volume(gaussians.means[rows]).value if len(rows) >= MIN_GAUSSIANS else np.nan
            if np.isnan(volume):
                continue
            sets.append((v, mask_id, rows, volume))
            best[rows] = np.maximum(best[rows], similarity[rows])
    cap = VOLUME_CAP * float(np.median([volume for *_, volume in sets])) if sets else 0.0
    n_masks = sum(len(np.setdiff1d(view.ids, [0, RIM_ID])) for view in ordered)
    kept = [(v, mask_id, rows) for v, mask_id, rows, volume in sets if volume <= cap]
    dropped = {"too_small": n_masks - len(sets), "too_large": len(sets) - len(kept)}
    candidates = np.unique(np.concatenate([np.zeros(0, np.int64), *(rows for *_, rows in kept)]))
    seen = np.array([view.weights.total for view in ordered], np.float32).reshape(len(ordered), len(gaussians))
    selections = tuple(
        BollSelection(ordered[v].camera.name, mask_id, rows, np.maximum(seen[v, rows], np.float32(LEAST_WEIGHT_PX)))
        for v, mask_id, rows in kept
    )
    names = tuple(view.camera.name for view in ordered)
    seen = np.ascontiguousarray(seen[:, candidates])
    return LiftedMasks(sha256, names, candidates, np.clip(best[candidates], 0, 1), seen, selections), dropped


def grow(means: NDArray[Any], seeds: NDArray[np.int64], alike: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The seeds and all similar Gaussians that short steps within a ball connect with a seed; ascending rows.

    Args:
        means: (N, 3) su.
        seeds: at least two rows, all alike.
        alike: (N,)
    """
    centre, widths = measure_extent(means[seeds])
    near = np.flatnonzero(alike & (np.linalg.norm(means - centre, axis=1) <= 0.5 * BALL * widths[0]))
    rows = np.union1d(near, seeds)
    points = np.asarray(means, np.float64)[rows]
    spacing = float(np.median(cKDTree(means[seeds]).query(means[seeds], k=2)[0][:, 1]))
    pairs = cKDTree(points).query_pairs(EDGE_SPACINGS * spacing, output_type="ndarray")
    graph = sparse.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(rows),) * 2)
    parts = connected_components(graph, directed=False)[1]
    return rows[np.isin(parts, parts[np.isin(rows, seeds)])]


def _render_inner_features(gaussians: Gaussians, unit: Float32, view: PromptView) -> dict[int, Float32]:
    """(P, C) rendered features of the pixels of each mask, without its outermost pixels."""
    import cv2

    inner = np.zeros(view.ids.shape, bool)
    names = [int(name) for name in np.unique(view.ids) if name not in (0, RIM_ID)]
    for name in names:
        inner |= cv2.erode((view.ids == name).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    y, x = np.nonzero(inner)
    rendered = find_heaviest_weights(gaussians, view.camera, np.column_stack([x, y])) @ unit
    found = {name: rendered[view.ids[y, x] == name] for name in names}
    return {name: features for name, features in found.items() if len(features)}


def _normalise(features: NDArray[Any]) -> NDArray[Any]:
    """At unit length along the last axis; zero stays zero."""
    unit: NDArray[Any] = features / np.maximum(np.linalg.norm(features, axis=-1, keepdims=True), 1e-6)
    return unit
