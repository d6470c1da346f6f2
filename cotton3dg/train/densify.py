# SPDX-License-Identifier: Apache-2.0
"""Adaptive density control: where the model gets more Gaussians, and which ones it drops.

Kerbl et al. 2023, section 5.2, with three departures that make a fixed budget reachable in a short training:
the number of Gaussians follows a schedule and the most needed ones are split until it is met (Taming-3DGS, Mallick et
al. 2024), instead of all above a threshold; the need is measured by absolute gradients, which do not cancel inside a
blurred Gaussian (AbsGS, Ye et al. 2024); and a Gaussian is always split along its longest axis so that its second
moment is kept, with no random numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Gaussians, rotations
from ..gaussians.state import arrays_of

FAINTEST_OPACITY: Final = 0.005
"""As in the paper. It is about 1/255, below which a Gaussian does not change any pixel."""

LEAST_WEIGHT: Final = 0.05
"""Mean blending weight, relative to the median Gaussian's, below which a Gaussian is hidden."""

SPLIT_SHRINKAGE: Final = 1.6
"""The paper's φ: by how much the children are shorter than their parent along its longest axis."""

CURVE_BITS: Final = 10
"""Cells along each axis of the curve that orders Gaussians in memory, as a power of two."""

_SPLIT_OFFSET: Final = np.sqrt(1 - SPLIT_SHRINKAGE**-2)
"""Distance of the children from the parent's mean, in its σ, that keeps the second moment along the axis."""


@dataclass(frozen=True)
class Densified:
    """Gaussians after density control, and where they come from."""

    gaussians: Gaussians
    rows: NDArray[np.int64]
    """(M,) row of the former Gaussians that each one continues or was split from."""
    continued: NDArray[np.bool_]
    """(M,) which go on unchanged; the others are children of splits, whose optimiser starts afresh."""
    n_pruned: int
    n_split: int


def densify(gaussians: Gaussians, keep: NDArray[np.bool_], need: NDArray[np.float64], count: int) -> Densified:
    """Drop the Gaussians that are not kept, then split the neediest ones until there are `count`.

    Args:
        keep: (N,) which Gaussians stay; more than `count` of them are cut to the neediest.
        need: (N,) how much a Gaussian should be split; not finite or not positive = never.
        count: the number of Gaussians aimed at, never exceeded; reached unless too few can be split.
    Returns:
        The Gaussians in `order_along_curve`: a step on neighbours in memory costs a tenth less.
    """
    need = np.where(np.isfinite(need) & (need > 0), need, 0.0)
    kept = np.flatnonzero(keep & gaussians.finite_rows)
    if len(kept) > count:
        kept = np.sort(kept[np.argsort(-need[kept], kind="stable")[:count]])
    splittable = kept[need[kept] > 0]
    chosen = splittable[np.argsort(-need[splittable], kind="stable")[: count - len(kept)]]
    chosen_mask = np.zeros(len(gaussians), bool)
    chosen_mask[chosen] = True
    whole, parents = kept[~chosen_mask[kept]], np.sort(chosen)
    children = concatenate(list(split(gaussians[parents])))
    order = order_along_curve(np.concatenate([gaussians.means[whole], children.means]))
    rows, is_child = np.concatenate([whole, parents, parents])[order], order >= len(whole)
    result, child = gaussians[rows], order[is_child] - len(whole)
    result.means[is_child] = children.means[child]
    result.log_scales[is_child] = children.log_scales[child]
    return Densified(result, rows, ~is_child, len(gaussians) - len(kept), len(parents))


def find_worth_keeping(gaussians: Gaussians, centres: NDArray[np.float64], closest_su: float) -> NDArray[np.bool_]:
    """(N,) whether a Gaussian is opaque enough to be seen and not right in front of one of the camera `centres`."""
    from scipy.spatial import cKDTree

    faintest_logit = np.log(FAINTEST_OPACITY / (1 - FAINTEST_OPACITY))
    keep: NDArray[np.bool_] = (gaussians.opacity_logits >= faintest_logit) & gaussians.finite_rows
    distances, _ = cKDTree(centres).query(gaussians.means[keep])
    keep[keep] = distances >= closest_su
    return keep


def find_contributing(weight: NDArray[Any], count: NDArray[Any]) -> NDArray[np.bool_]:
    """(N,) whether a Gaussian adds to the images: its mean blending weight is at least LEAST_WEIGHT of the median one.

    The others hide behind or inside surfaces. They cost memory, never get a gradient that could move them out, and
    do not show in the photos. All stay if no image showed any.

    Args:
        weight: (N,) blending weights summed over images, as `DensityStatistics` has them.
        count: (N,) number of images that showed it.
    """
    mean = np.where(count > 0, weight / np.maximum(count, 1), 0.0)
    seen = mean[np.isfinite(mean) & (mean > 0)]
    return mean >= LEAST_WEIGHT * np.median(seen) if len(seen) else np.ones(len(mean), bool)


def split(parents: Gaussians) -> tuple[Gaussians, Gaussians]:
    """Two children of each Gaussian, side by side along its longest axis, of the same opacity and colour.

    The mixture has the parent's mean and second moment, and its peak to within 10 %. It hides more than the parent: a
    quarter more from the side (2 / SPLIT_SHRINKAGE), 1.3 to 1.6 times as much over all directions. Children that hide
    as much are fainter, and training does worse with them (docs/notes/training_ingredients.md).
    """
    n = len(parents)
    longest = np.argmax(parents.log_scales, axis=1)
    axes = rotations(parents.quats)[np.arange(n), :, longest]
    sigma = np.exp(parents.log_scales[np.arange(n), longest].astype(np.float64))
    offsets = (axes * (sigma * _SPLIT_OFFSET)[:, None]).astype(np.float32)
    log_scales = parents.log_scales.copy()
    log_scales[np.arange(n), longest] -= np.float32(np.log(SPLIT_SHRINKAGE))

    def child(means: NDArray[np.float32]) -> Gaussians:
        return Gaussians(means, parents.quats, log_scales, parents.opacity_logits, parents.sh)

    return child(parents.means + offsets), child(parents.means - offsets)


def concatenate(parts: list[Gaussians]) -> Gaussians:
    """All Gaussians of `parts` in order, in arrays of their own."""
    return Gaussians(*(np.concatenate(arrays) for arrays in zip(*map(arrays_of, parts), strict=True)))


def order_along_curve(means: NDArray[Any]) -> NDArray[np.int64]:
    """(N,) the rows along a Z-order curve (Morton 1966) through the (N, 3) means: near in the list, near in space.

    The grid spans all but the outermost percents, so that a far floater does not make it coarse; equal cells keep
    their order.
    """
    if not len(means):
        return np.zeros(0, np.int64)
    low, high = np.quantile(means, [0.01, 0.99], axis=0)
    cells = np.clip((means - low) / np.maximum(high - low, 1e-30), 0, 1) * (2**CURVE_BITS - 1)
    bits = (cells.astype(np.uint32)[:, :, None] >> np.arange(CURVE_BITS, dtype=np.uint32)) & 1
    places = 3 * np.arange(CURVE_BITS, dtype=np.uint32) + np.arange(3, dtype=np.uint32)[:, None]
    return np.argsort((bits << places).sum(axis=(1, 2)), kind="stable")


def growth_score(abs_grad_px: NDArray[Any], count: NDArray[Any]) -> NDArray[np.float64]:
    """(N,) mean absolute gradient of the loss by a Gaussian's position in the images that saw it.

    Args:
        abs_grad_px: (N,) summed over the images, per px.
        count: (N,) number of images that saw it.
    Returns:
        Finite and not negative; 0 for Gaussians that no image saw or whose sums are not finite.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        need = np.asarray(abs_grad_px, np.float64) / np.asarray(count, np.float64)
    return np.where(np.isfinite(need) & (need > 0), need, 0.0)


def scheduled_count(start: int, budget: int, progress: float) -> int:
    """Number of Gaussians at `progress` in 0..1 of densification: from `start` to `budget`, faster at first.

    Splitting early gives every new Gaussian more steps to settle. Python integers: no count can overflow.
    """
    eased = 1.0 - (1.0 - min(max(progress, 0.0), 1.0)) ** 2
    return min(budget, start + round((budget - start) * eased))
