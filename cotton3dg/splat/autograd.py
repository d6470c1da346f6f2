"""The core's values as a torch function, so that any loss on a rendered map can be minimised by torch."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..core.scene import Camera, Gaussians
from .rasterizer import render_values, values_gradient


def rasterize_values(
    values: torch.Tensor,
    gaussians: Gaussians,
    camera: Camera,
    background: NDArray[Any] | None = None,
    *,
    threads: int = 0,
    near_su: float | None = None,
) -> torch.Tensor:
    """`render_values(...).image` as a differentiable function of a float32 (N, C) CPU tensor; geometry is frozen."""

    class RasterizeValues(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, values: torch.Tensor) -> torch.Tensor:
            rows = np.ascontiguousarray(values.detach().numpy())
            rendered = render_values(gaussians, camera, rows, background=background, threads=threads, near_su=near_su)
            return torch.from_numpy(rendered.image)

        @staticmethod
        def backward(ctx: Any, v_image: torch.Tensor) -> torch.Tensor:
            v = np.ascontiguousarray(v_image.detach().numpy())
            return torch.from_numpy(values_gradient(gaussians, camera, v, threads=threads, near_su=near_su))

    return RasterizeValues.apply(values)
