# SPDX-License-Identifier: Apache-2.0
"""LPIPS of a study, by a network of one's own."""

import math

import numpy as np
import pytest
import torch
from scenes.splat_scenes import round_gaussians

from cotton3dg.core.scene import Camera
from cotton3dg.errors import BadInput
from cotton3dg.gaussians.views import View
from cotton3dg.study.lpips import measure_lpips


def test_lpips_is_the_mean_over_held_out_images(tmp_path):
    """A network that gives the mean of the squared difference; white is 2 from the black of no Gaussian."""

    class Square(torch.nn.Module):
        def forward(self, first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
            return ((first - second) ** 2).mean()

    torch.jit.script(Square()).save(str(tmp_path / "square.pt"))
    nothing = round_gaussians(np.zeros((0, 3)), 1.0)
    camera = Camera("a.jpg", 8, 6, 5.0, 5.0, 4.0, 3.0, np.eye(4)[:3])
    views = [View(camera, np.full((6, 8, 3), grey, np.uint8)) for grey in (255, 0)]
    assert measure_lpips(tmp_path / "square.pt", nothing, views, {}) == pytest.approx(2.0)
    assert math.isnan(measure_lpips(None, nothing, views, {}))
    (tmp_path / "none.pt").write_bytes(b"no network")
    with pytest.raises(BadInput, match=r"docs/papers\.md"):
        measure_lpips(tmp_path / "none.pt", nothing, views, {})
