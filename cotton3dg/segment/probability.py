# SPDX-License-Identifier: Apache-2.0
"""Probability of every Gaussian to be lint, fitted to the masks of many views (seed paper "binary segmentation").

Each Gaussian has one p in 0..1; a view's map is P = sum of p alpha T, front to back (Eq. 2). The mean binary
cross-entropy between P and the union of the view's masks is minimised with Adam, one view a step, and p is clamped
after each step; the geometry stays as it is. With frozen geometry P is linear in p, P = W p, and the gradient by p is
Wᵀ dL/dP: the blending weights W of a view's rays are computed once and two sparse products replace a render and its
backward pass. With a ray for every pixel that is the same training, up to rounding.

Departures: by default one ray stands for each 4 x 4 px, drawn anew in every view (unbiased; four such rays cross the
smallest boll that can be recognised); p starts at 0.5, which the paper leaves open; views come in random order without
repetition; P is kept away from 0 and 1 in the loss.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ..core.scene import Camera, Float32, Gaussians
from ..gaussians.rasterizer import ray_weights

LEARNING_RATE: Final = 0.0005
MAP_MARGIN: Final = 0.01
"""Least distance of P from 0 and 1 in the loss. Adam's steps stay short for thousands of steps after a large gradient,
so rays that no p can explain, or a wrong start, would stop all Gaussians that they cross."""
ADAM_EPSILON: Final = np.float32(1e-15)
"""Adam's ε. A Gaussian's share of the gradient may be 1e-9 or less, see Kerbl et al.; torch's 1e-8 would slow it
down."""
THRESHOLDS: Final = (0.7, 0.75, 0.8, 0.9)
"""Thresholds of the paper's Table I."""
REPORTED_STEPS: Final = (3000, 7000, 10_000, 12_000)
"""Numbers of steps in the same table."""


class TrainingView(NamedTuple):
    """One view's map of probabilities as a linear function, and its target."""

    render: Callable[[Float32], Float32]
    """(N,) probabilities -> (R,) map at the view's rays."""
    gradient: Callable[[Float32], Float32]
    """Its transpose: (R,) gradient by the map -> (N,) by the probabilities."""
    targets: Float32
    """(R,) 1 inside a mask, 0 outside."""


def sample_pixels(width: int, height: int, spacing_px: int, seed: int) -> NDArray[np.int64]:
    """(R, 2) pixels (x, y): one at random in each square of `spacing_px` px; a spacing of 1 takes all pixels."""
    corners = np.stack(np.meshgrid(np.arange(0, width, spacing_px), np.arange(0, height, spacing_px)), axis=-1)
    drawn = corners + np.random.default_rng(seed).integers(0, spacing_px, corners.shape)
    pixels = drawn.reshape(-1, 2)
    return pixels[(pixels < (width, height)).all(axis=1)]


def sample_view(
    gaussians: Gaussians, camera: Camera, inside: NDArray[np.bool_], spacing_px: int, seed: int
) -> TrainingView:
    """Sampled rays of one view.

    Args:
        camera: of the size of `inside`.
        inside: (H, W) union of the masks.
    """
    pixels = sample_pixels(camera.width, camera.height, spacing_px, seed)
    rays = ray_weights(gaussians, camera, pixels)
    weights = sparse.csr_matrix((rays.weights, rays.rows, rays.starts), shape=(len(pixels), len(gaussians)))
    return TrainingView(weights.dot, weights.T.dot, inside[pixels[:, 1], pixels[:, 0]].astype(np.float32))


def train_probabilities(
    views: Sequence[TrainingView], start: Float32, steps: int, seed: int = 0, learning_rate: float = LEARNING_RATE
) -> Iterator[tuple[int, Float32]]:
    """Minimise the cross-entropy; yields the number of steps done and the (N,) probabilities after each step.

    Args:
        views: at least one.
        start: (N,) initial probabilities; those of Gaussians that no view shows stay.
    Yields:
        the array that is being optimised: copy it to keep its values.
    """
    rng = np.random.default_rng(seed)
    probabilities = start.astype(np.float32)
    first, second = np.zeros_like(probabilities), np.zeros_like(probabilities)
    order: list[int] = []
    for step in range(1, steps + 1):
        order = order or rng.permutation(len(views)).tolist()
        view = views[order.pop()]
        v_map = cross_entropy_gradient(view.render(probabilities), view.targets)
        v = view.gradient(v_map)
        # Adam (Kingma & Ba 2015) with its usual constants.
        first += 0.1 * (v - first)
        second += 0.001 * (v * v - second)
        rate = learning_rate * (1 - 0.999**step) ** 0.5 / (1 - 0.9**step)
        probabilities -= np.float32(rate) * first / (np.sqrt(second) + ADAM_EPSILON)
        np.clip(probabilities, 0, 1, out=probabilities)
        yield step, probabilities


def cross_entropy_gradient(probability_map: Float32, targets: Float32) -> Float32:
    """Gradient of the mean binary cross-entropy by a map of probabilities, which are clipped to the margin first."""
    held = np.clip(probability_map, MAP_MARGIN, 1 - MAP_MARGIN)
    return (held - targets) / (held * (1 - held) * np.float32(max(len(targets), 1)))


def mean_binary_ious(maps: Iterable[Float32], masks: Iterable[NDArray[np.bool_]]) -> NDArray[np.float64]:
    """The paper's mBIoU, taken as the mean over views of the intersection over union of two binary images.

    (A boundary IoU, whose band is usually 2 % of the image's diagonal, is the same here: bolls are no wider than it.)

    Args:
        maps: (H, W, C) a view, C maps to be judged. masks: (H, W) union of its masks.
    Returns:
        (C, T) for the maps above each of `THRESHOLDS`, over the views with anything in them; NaN without such a view.
    """
    total, count = 0.0, 0.0
    for image, inside in zip(maps, masks, strict=True):
        above = image[..., None] > np.array(THRESHOLDS, np.float32)
        union = (above | inside[..., None, None]).sum(axis=(0, 1))
        total += (above & inside[..., None, None]).sum(axis=(0, 1)) / np.maximum(union, 1)
        count += union > 0
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
