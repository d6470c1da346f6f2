# SPDX-License-Identifier: Apache-2.0
"""LPIPS (Zhang et al. 2018): the difference of two images to a trained network, if the user has one.

The network is a TorchScript file that takes two images (1, 3, H, W) in -1..1 and gives a number; docs/papers.md says
how to make it with the `lpips` package, which brings the weights.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..core.scene import Gaussians
from ..errors import BadInput
from ..gaussians.rasterizer import render
from ..gaussians.views import View

MOST_VIEWS: Final = 8
"""Largest number of held-out images to judge; a network takes seconds for one."""


def measure_lpips(weights: Path | None, gaussians: Gaussians, views: Sequence[View], gains: Mapping[str, Any]) -> float:
    """Mean over up to `MOST_VIEWS` views, 0 = alike; NaN without weights or views.

    Args:
        gains: image -> (3,) factors for its render.
    Raises:
        BadInput: the file is not such a network.
    """
    if weights is None or not views:
        return math.nan
    import torch

    try:
        network = torch.jit.load(str(weights), map_location="cpu").eval()
        chosen = [views[round(i)] for i in np.linspace(0, len(views) - 1, min(MOST_VIEWS, len(views)))]
        with torch.no_grad():
            return float(np.mean([_distance(network, gaussians, view, gains) for view in chosen]))
    except (RuntimeError, ValueError, TypeError) as error:
        raise BadInput(
            f"{weights.name} is not an LPIPS network ({str(error).splitlines()[0]}); see docs/papers.md"
        ) from error


def _distance(network: Any, gaussians: Gaussians, view: View, gains: Mapping[str, Any]) -> float:
    import torch

    gain = np.array(gains.get(view.camera.name, (1.0, 1.0, 1.0)), np.float32)
    pair = (np.clip(render(gaussians, view.camera).image * gain, 0, 1), view.image.astype(np.float32) / 255)
    first, second = (torch.from_numpy(2 * image - 1).permute(2, 0, 1)[None].contiguous() for image in pair)
    return float(network(first, second))
