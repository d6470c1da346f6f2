# SPDX-License-Identifier: Apache-2.0
"""Loss and gradients of the native core one by one, which the package only takes together in `train_step`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cotton3dg._native import View, for_tests
from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians import rasterizer
from cotton3dg.gaussians.harmonics import basis
from scenes.splat_scenes import arrays_of, native_view

Arrays = tuple[NDArray[Any], ...]


@dataclass(frozen=True)
class LossGradients:
    """Gradient of the loss by every parameter, and this view's share of the density statistics."""

    loss: float
    l1: float
    ssim: float
    finite: bool
    v_means: NDArray[Any]
    v_quats: NDArray[Any]
    v_log_scales: NDArray[Any]
    v_opacity_logits: NDArray[Any]
    v_sh: NDArray[Any]
    abs_grad_px: NDArray[Any]
    weight: NDArray[Any]


def image_loss(
    image: NDArray[Any], target: NDArray[np.uint8], *, dssim: float = 0.2, threads: int = 0
) -> tuple[dict[str, float], NDArray[Any]]:
    """{loss, l1, ssim} of a (H, W, 3) image in 0..1 and the gradient by it, as large; see `train_step`."""
    return for_tests.image_loss(np.ascontiguousarray(image), np.ascontiguousarray(target), dssim, threads)


def loss_and_gradients(
    gaussians: Gaussians,
    camera: Camera,
    target: NDArray[np.uint8],
    *,
    sh_degree: int | None = None,
    background: rasterizer.Background = rasterizer.BLACK,
    dssim: float = 0.2,
    threads: int = 0,
    near_su: float | None = None,
) -> LossGradients:
    """Loss of one view against its photograph (H, W, 3) uint8 and all gradients; see `train_step`."""
    degree = gaussians.sh_degree if sh_degree is None else sh_degree
    near = rasterizer.near_plane(gaussians, camera) if near_su is None else near_su
    report, found = view_gradients(
        arrays_of(gaussians),
        native_view(camera, near),
        degree,
        np.array(background, np.float32),
        np.ascontiguousarray(target),
        dssim,
        threads,
    )
    del found["v_colours"]
    return LossGradients(**report, **found)


def view_gradients(
    arrays: Arrays, view: View, degree: int, background: NDArray[Any], target: NDArray[Any], dssim: float, threads: int
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """{loss, l1, ssim, finite} against a photograph, and the gradients by all parameters, in their precision."""
    report, found, _ = for_tests.gradients(arrays, view, degree, background, target, dssim, threads)
    return report, _with_v_sh(found, arrays[4], degree)


def image_gradient(
    arrays: Arrays, view: View, degree: int, background: NDArray[Any], v_image: NDArray[Any], threads: int
) -> tuple[bool, dict[str, NDArray[Any]]]:
    """Whether the gradients by all parameters are finite, and they, for a gradient by the image (H, W, 3)."""
    report, found, _ = for_tests.image_gradient(arrays, view, degree, background, v_image, threads)
    return report["finite"], _with_v_sh(found, arrays[4], degree)


def _with_v_sh(found: dict[str, NDArray[Any]], sh: NDArray[Any], degree: int) -> dict[str, NDArray[Any]]:
    """The gradient by the (N, K, 3) harmonics in place of the directions; the core computes it inside Adam only."""
    functions = basis(found.pop("directions"), (degree + 1) ** 2)
    v_sh = np.zeros_like(sh)
    v_sh[:, : functions.shape[1]] = functions[:, :, None] * found["v_colours"][:, None]
    return found | {"v_sh": v_sh}
