# SPDX-License-Identifier: Apache-2.0
"""The checked face of the C++ core: render, accumulate weights, take an optimiser step.

Everything here is a pure function of its arguments, bit by bit independent of the number of threads, except
`train_step`, which changes the arrays it is given. `threads` = 0 takes all cores. Nothing nearer to the camera than
`near_su` is drawn; None takes `near_plane` of the scene.

Blending follows Kerbl et al. 2023 and is one sum for colours, probabilities and features (the seed papers' Eq. 1-3):
sum over Gaussians, front to back, of value * alpha * transmittance. Departures from their code: the footprint is cut
at alpha = 1/255 exactly (not at 3 sigma), a pixel is finished after the Gaussian that takes its transmittance to 1e-4
or less (not before it), equal depths are drawn in row order, and alpha beyond its cap of 0.99 has no gradient.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from cotton3dg import _native
from cotton3dg.core.scene import Camera, Float32, Gaussians
from cotton3dg.errors import OutOfResources
from cotton3dg.gaussians.state import AdamState, DensityStatistics, LearningRates, arrays_of

T = TypeVar("T")
Background = tuple[float, float, float] | NDArray[Any]
BLACK: Final = (0.0, 0.0, 0.0)
Window = tuple[int, int, int, int]
"""Part of an image: left, top, width, height, px."""
_CHANNELS: Final = (1, 3, 4, 16, 32)
_NEAR_PER_DEPTH: Final = 0.02


@dataclass(frozen=True)
class Rendered:
    """One view of the Gaussians."""

    image: Float32
    """(H, W, C)"""
    transmittance: Float32
    """(H, W) share of the background that shows through."""
    depth: Float32
    """(H, W) blended view-space depth, su; 0 where nothing was blended."""
    n_pairs: int
    """(tile, Gaussian) pairs."""
    n_visible: int
    culled: dict[str, int]
    """Gaussians not drawn, by reason: non_finite (or a colour beyond 1e6), behind, degenerate, faint, outside."""


@dataclass(frozen=True)
class Accumulated:
    """Blending weights (transmittance * alpha) of one view, summed over pixels."""

    total: Float32
    """(N,) over all pixels."""
    rows: NDArray[np.int64]
    """(P,) Gaussian of each non-zero sum inside a mask; sorted by (row, id)."""
    ids: NDArray[np.uint16]
    """(P,) mask id > 0."""
    weights: Float32
    """(P,)"""


@dataclass(frozen=True)
class RayWeights:
    """Blending weights of single pixels: a sparse matrix of R rays x N Gaussians, compressed by rows (CSR)."""

    starts: NDArray[np.int64]
    """(R + 1,) where each ray begins."""
    rows: NDArray[np.int32]
    """(P,) Gaussians, those of a ray front to back."""
    weights: Float32
    """(P,) > 0; 1 minus a ray's sum is its transmittance."""


@dataclass(frozen=True)
class StepReport:
    """The result of one training step; when its loss is not `finite`, nothing was changed."""

    loss: float
    l1: float
    ssim: float
    n_visible: int
    n_pairs: int
    culled: dict[str, int]
    finite: bool
    n_skipped: int = 0
    """Gaussians that stayed as they were because their gradient was not finite."""


def near_plane(gaussians: Gaussians, camera: Camera) -> float:
    """1/50 of the median depth in front of the camera, su; from at most 1024 evenly spaced Gaussians.

    Relative, because the unit of a structure-from-motion scene is arbitrary.
    """
    means = gaussians.means[:: max(1, len(gaussians) // 1024)].astype(np.float64)
    depths = means @ camera.rotation[2] + camera.cam_from_scene[2, 3]
    depths = depths[np.isfinite(depths) & (depths > 0)]
    return float(np.median(depths)) * _NEAR_PER_DEPTH if len(depths) else 1e-6


def render(
    gaussians: Gaussians,
    camera: Camera,
    *,
    sh_degree: int | None = None,
    background: Background = BLACK,
    threads: int = 0,
    near_su: float | None = None,
) -> Rendered:
    """Render the colours of the spherical harmonics up to `sh_degree` (None: all there are).

    Raises:
        OutOfResources: more (tile, Gaussian) pairs than memory is meant for.
    """
    degree = gaussians.sh_degree if sh_degree is None else sh_degree
    view = _view(gaussians, camera, near_su)
    image, transmittance, depth, counts = _within_memory(
        lambda: _native.render(_contiguous(gaussians), view, degree, np.array(background, np.float32), threads)
    )
    return Rendered(image, transmittance, depth, **counts)


def render_values(
    gaussians: Gaussians,
    camera: Camera,
    values: Float32,
    *,
    background: NDArray[Any] | None = None,
    threads: int = 0,
    near_su: float | None = None,
) -> Rendered:
    """Render any (N, C) float32 values; `background` (C,), None = zeros. Transmittance and depth as in `render`.

    Raises:
        OutOfResources: more (tile, Gaussian) pairs than memory is meant for.
    """
    if values.dtype != np.float32 or values.ndim != 2 or len(values) != len(gaussians) or values.shape[1] == 0:
        raise ValueError(f"values must be float32 ({len(gaussians)}, C), got {values.dtype} {values.shape}")
    channels = values.shape[1]
    backdrop = np.zeros(channels, np.float32) if background is None else np.array(background, np.float32)
    if backdrop.shape != (channels,):
        raise ValueError(f"background must have {channels} channels, got {backdrop.shape}")
    view = _view(gaussians, camera, near_su)
    parts = []
    for begin, end, width in _channel_groups(channels):
        rows, behind = _pad(values[:, begin:end], width), _pad(backdrop[begin:end], width)
        parts.append(
            _within_memory(partial(_native.render_values, _contiguous(gaussians), rows, view, behind, threads))
        )
    image = parts[0][0] if len(parts) == 1 else np.concatenate([part[0] for part in parts], axis=2)
    return Rendered(np.ascontiguousarray(image[..., :channels]), parts[0][1], parts[0][2], **parts[0][3])


def accumulate_weights(
    gaussians: Gaussians,
    camera: Camera,
    mask_ids: NDArray[np.uint16],
    *,
    threads: int = 0,
    near_su: float | None = None,
) -> Accumulated:
    """Sum every Gaussian's blending weights over the view and inside each mask of `mask_ids` (H, W), 0 = background."""
    view = _view(gaussians, camera, near_su)
    return Accumulated(
        *_within_memory(lambda: _native.accumulate_weights(_contiguous(gaussians), view, mask_ids, threads))
    )


def ray_weights(
    gaussians: Gaussians, camera: Camera, pixels: NDArray[Any], *, threads: int = 0, near_su: float | None = None
) -> RayWeights:
    """The weight of every Gaussian at chosen `pixels` (R, 2) int (x, y), in any order: what rendering blends there.

    Raises:
        OutOfResources: more (tile, Gaussian) pairs than memory is meant for.
    """
    if not np.issubdtype(pixels.dtype, np.integer):
        raise ValueError(f"pixels must be integers (R, 2), got {pixels.dtype}")
    view, rays = _view(gaussians, camera, near_su), np.ascontiguousarray(pixels, np.int64)
    return RayWeights(*_within_memory(lambda: _native.ray_weights(_contiguous(gaussians), view, rays, threads)))


def train_step(
    gaussians: Gaussians,
    adam: AdamState,
    statistics: DensityStatistics,
    camera: Camera,
    target: NDArray[np.uint8],
    *,
    sh_degree: int,
    background: Background = BLACK,
    learning_rates: LearningRates,
    rate_factors: Float32 | None = None,
    dssim: float = 0.2,
    threads: int = 0,
    near_su: float | None = None,
    window: Window | None = None,
) -> StepReport:
    """Render one view, compare it with its photograph (H, W, 3) uint8 and update the Gaussians in view, all in place.

    With a `window` only that part of the photograph is rendered and compared, at the cost of that part. Its pixels
    have the same weight as in the whole image; the reported loss is their mean.

    The loss is (1 - dssim) L1 + dssim (1 - SSIM), a mean over pixels and channels; SSIM as in Kerbl et al.: 11 x 11
    Gaussian window, sigma 1.5, zero padding. When the loss is not finite nothing is changed, and a Gaussian whose
    gradient is not finite stays as it was; the report says so.

    Args:
        rate_factors: (N, 2) by which the rates of each Gaussian's mean and log scales are multiplied; None = 1.
    Raises:
        ValueError: an array of wrong dtype, shape or memory order.
        OutOfResources: more (tile, Gaussian) pairs than memory is meant for.
    """
    factors = np.ones((len(gaussians), 2), np.float32) if rate_factors is None else rate_factors
    step = partial(
        _native.train_step,
        state=_native.OptimiserState(
            gaussians=arrays_of(gaussians),
            first=arrays_of(adam.first),
            second=arrays_of(adam.second),
            steps=adam.steps,
        ),
        statistics=_native.Statistics(**vars(statistics)),
        view=_view(gaussians, camera, near_su, window),
        sh_degree=sh_degree,
        background=np.array(background, np.float32),
        target=np.ascontiguousarray(target),
        dssim=dssim,
        rates=_native.LearningRates(**vars(learning_rates)),
        rate_factors=factors,
        threads=threads,
    )
    return StepReport(**_within_memory(step))


def _contiguous(gaussians: Gaussians) -> _native.Arrays:
    means, quats, log_scales, opacity_logits, sh = map(np.ascontiguousarray, arrays_of(gaussians))
    return means, quats, log_scales, opacity_logits, sh


def view_of(camera: Camera, near: float, window: Window | None = None) -> _native.View:
    """A camera as the core takes it; `near`, in the unit of its scene, is the depth at which it begins to see."""
    pose = np.ascontiguousarray(camera.cam_from_scene, np.float64)
    return _native.View(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, pose, near, window)


def _view(gaussians: Gaussians, camera: Camera, near_su: float | None, window: Window | None = None) -> _native.View:
    return view_of(camera, near_plane(gaussians, camera) if near_su is None else near_su, window)


def _within_memory(compute: Callable[[], T]) -> T:
    try:
        return compute()
    except MemoryError:
        raise OutOfResources(
            "the Gaussians overlap too many image tiles for the memory; use fewer Gaussians or smaller images"
        ) from None


def _channel_groups(channels: int) -> list[tuple[int, int, int]]:
    """(begin, end, padded width) of the groups in which the core takes this many channels."""
    largest = _CHANNELS[-1]
    return [
        (begin, end := min(begin + largest, channels), next(c for c in _CHANNELS if c >= end - begin))
        for begin in range(0, channels, largest)
    ]


def _pad(array: NDArray[Any], width: int) -> NDArray[Any]:
    """The array, contiguous, with zeros up to `width` in the last axis."""
    missing = width - array.shape[-1]
    if missing:
        array = np.concatenate([array, np.zeros((*array.shape[:-1], missing), array.dtype)], axis=-1)
    return np.ascontiguousarray(array)
