# SPDX-License-Identifier: Apache-2.0
"""Affinity features: one vector per Gaussian, alike within a boll and unlike between bolls (Cotton3DGaussians,
Eq. 3-10, after SAGA by Cen et al. 2023).

Features of unit length, smoothed over 16 nearest neighbours, are blended like colours: F = sum of f alpha T (Eq. 3).
The geometry is frozen, so F = W f; the weights W of 4,096 rays a view are computed once, the 16 largest of each.

The paper leaves much open. Our readings, all departures:

- Eq. 4 and 5: masks come without SAM features, so the query T_M of a mask is the mean of the rendered features in it,
  taken as constant.
- Eq. 6: p = sigmoid(10 (cos(T_M, F) - 0.5)); a softmax over pixels would make it 0.5 everywhere.
- Eq. 7: means over the pixels inside and outside of each mask count alike; a sum would tie β to the resolution.
- Eq. 8-10: of two rays K = 1 in one mask, -1 in two masks or in a mask and the background, none in the background;
  cosines below 0 cost a pair of K = -1 nothing (as in SAGA), and both kinds count alike. β = 1.
- (1 - |F|)² is added, so that the features along a ray agree with each other.
- A step takes 1,024 rays of one view: half from masks, evenly over these, a quarter from a ring of 10 px around them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ..core.runs import Progress, silent
from ..core.scene import Camera, Float32, Gaussians
from ..gaussians.rasterizer import ray_weights

if TYPE_CHECKING:
    import torch


LEARNING_RATE: Final = 0.0025
RAYS_PER_VIEW: Final = 4096
RAYS_PER_STEP: Final = 1024
GAUSSIANS_PER_RAY: Final = 16
NEIGHBOURS: Final = 16
RING_PX: Final = 10
BETA: Final = 1.0
LEAST_LENGTH: Final = 1e-6
"""Features shorter than this have no direction. torch's own 1e-12 would turn rounding errors into unit vectors."""


class FeatureRays(NamedTuple):
    """Rays of one view and the mask that each one hits."""

    weights: sparse.csr_matrix
    """(R, N)"""
    ids: NDArray[np.int64]
    """(R,) 0 = background."""


def sample_rays(
    gaussians: Gaussians, camera: Camera, mask_ids: NDArray[np.uint16], smoothing: sparse.csr_matrix, seed: int
) -> FeatureRays:
    """Rays of one view, half of them in masks.

    Args:
        camera: of the size of `mask_ids`.
        mask_ids: (H, W), 0 = background.
        smoothing: as `neighbour_means` gives it.
    """
    import cv2

    rng = np.random.default_rng(seed)
    inside = mask_ids > 0
    # Each mask has the same share of the rays, whatever its size.
    names, sizes = np.unique(mask_ids[inside], return_counts=True)
    share = np.zeros(mask_ids.shape)
    share[inside] = 1 / sizes[np.searchsorted(names, mask_ids[inside])]
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * RING_PX + 1, 2 * RING_PX + 1))
    ring = (cv2.dilate(inside.astype(np.uint8), disc) > 0) & ~inside
    chosen = [
        _draw(rng, share, RAYS_PER_VIEW // 2),
        _draw(rng, ring.astype(float), RAYS_PER_VIEW // 4),
        _draw(rng, (~inside & ~ring).astype(float), RAYS_PER_VIEW // 4),
    ]
    y, x = np.unravel_index(np.concatenate(chosen), mask_ids.shape)
    weights = find_heaviest_weights(gaussians, camera, np.column_stack([x, y]))
    return FeatureRays((weights @ smoothing).tocsr(), mask_ids[y, x].astype(np.int64))


def _draw(rng: np.random.Generator, shares: NDArray[Any], count: int) -> NDArray[np.int64]:
    """At most `count` different flat indices, drawn with probabilities in proportion to their shares."""
    able = np.flatnonzero(shares)
    # The smallest of exponential times, see Efraimidis and Spirakis 2006.
    times = rng.exponential(size=len(able)) / shares.ravel()[able]
    return able[np.argpartition(times, count)[:count]] if count < len(able) else able


def find_heaviest_weights(gaussians: Gaussians, camera: Camera, pixels: NDArray[Any]) -> sparse.csr_matrix:
    """(R, N) the 16 largest blending weights of the rays at (R, 2) pixels."""
    rays = ray_weights(gaussians, camera, pixels)
    ray = np.repeat(np.arange(len(pixels)), np.diff(rays.starts))
    order = np.lexsort((-rays.weights, ray))
    kept = order[np.arange(len(order)) - rays.starts[ray] < GAUSSIANS_PER_RAY]
    shape = (len(pixels), len(gaussians))
    return sparse.csr_matrix((rays.weights[kept], (ray[kept], rays.rows[kept])), shape=shape)


def neighbour_means(means: NDArray[Any]) -> sparse.csr_matrix:
    """(N, N) matrix that averages over the 16 nearest of (N, 3) points, themselves among them."""
    from scipy.spatial import cKDTree

    count = min(NEIGHBOURS, len(means))
    found = cKDTree(means).query(means, k=np.arange(1, count + 1))[1]
    starts = np.arange(len(means) + 1) * count
    values = np.full(found.size, 1 / max(count, 1), np.float32)
    return sparse.csr_matrix((values, found.ravel(), starts), shape=(len(means), len(means)))


def train_features(
    views: Sequence[FeatureRays], n: int, channels: int, steps: int, seed: int = 0, progress: Progress = silent
) -> tuple[Float32, list[float]]:
    """Unit features for the masks of many views.

    Args:
        views: views without a ray in a mask do not count.
        n: number of Gaussians.
    Returns:
        (n, channels) features before smoothing, zero for Gaussians on no ray; and the loss of each step.
    """
    import torch

    views = [view for view in views if view.ids.any()]
    if not views:
        return np.zeros((n, channels), np.float32), []
    rng = np.random.default_rng(seed)
    losses: list[float] = []
    order: list[int] = []
    shown = np.zeros(n, bool)
    for view in views:
        shown[view.weights.indices] = True
    with _one_thread():
        raw = torch.from_numpy(rng.normal(size=(n, channels)).astype(np.float32))
        raw.grad = torch.zeros_like(raw)
        optimiser = torch.optim.Adam([raw], lr=LEARNING_RATE, fused=True)
        for step in range(steps):
            order = order or rng.permutation(len(views)).tolist()
            view = views[order.pop()]
            rows = np.sort(rng.permutation(len(view.ids))[:RAYS_PER_STEP])
            block, used = _used_columns(view.weights[rows])
            features = raw[used].requires_grad_()
            unit = normalise(features)
            rendered = torch.from_numpy(block @ unit.detach().numpy()).requires_grad_()
            loss = affinity_loss(rendered, torch.from_numpy(view.ids[rows]))
            loss.backward()
            unit.backward(torch.from_numpy(block.T @ rendered.grad.numpy()))
            raw.grad[used] = features.grad
            optimiser.step()
            raw.grad[used] = 0
            losses.append(loss.item())
            if step % 50 == 0:
                progress(step, steps, "features")
        raw[~shown] = 0
        return normalise(raw).numpy(), losses


def _used_columns(matrix: sparse.csr_matrix) -> tuple[sparse.csr_matrix, NDArray[np.int64]]:
    """The matrix without its empty columns, and which ones are left."""
    flags = np.zeros(matrix.shape[1], bool)
    flags[matrix.indices] = True
    used = np.flatnonzero(flags)
    position = np.cumsum(flags, dtype=np.int32) - 1
    shape = (matrix.shape[0], len(used))
    return sparse.csr_matrix((matrix.data, position[matrix.indices], matrix.indptr), shape=shape), used


def normalise(features: torch.Tensor) -> torch.Tensor:
    """(N, D) rows at unit length; rows without direction become zero and get no gradient."""
    import torch

    lengths = features.norm(dim=1, keepdim=True)
    known = lengths > LEAST_LENGTH
    return torch.where(known, features, 0.0) / torch.where(known, lengths, 1.0)


def affinity_loss(rendered: torch.Tensor, ids: torch.Tensor) -> torch.Tensor:
    """Eq. 5-10 of (R, C) rendered features and the (R,) masks they lie in, 0 = background; zero without a mask."""
    import torch
    from torch.nn.functional import softplus

    unit = normalise(rendered)
    stray = (1 - rendered.norm(dim=1)).square().mean()
    names = torch.unique(ids[ids > 0])
    if not len(names):
        return 0 * stray
    member = (ids == names[:, None]).float()
    queries = normalise(member @ rendered.detach())
    logits = 10 * (queries @ unit.T - 0.5)
    by_mask = _mean(softplus(-logits), member, 1) + _mean(softplus(logits), 1 - member, 1)
    masked = unit[ids > 0]
    with torch.no_grad():
        # The loss is linear in the cosines as long as none changes sign. With its slopes the backward pass does not
        # need the matrix of cosines.
        same = ids[ids > 0][:, None] == ids
        alike = ~same & (masked @ unit.T > 0)
        slopes = alike / (~same).sum().clamp(min=1) - same / same.sum()
    by_pair = 1 + ((slopes @ unit) * masked).sum()
    return by_mask.mean() + BETA * by_pair + stray


def _mean(values: torch.Tensor, weights: torch.Tensor, dim: int | None = None) -> torch.Tensor:
    """Weighted mean; zero where all weights are."""
    return (values * weights).sum(dim) / weights.sum(dim).clamp(min=1)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Run torch in one thread. Its pool costs more than the small operations of a step, most on a busy machine."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
