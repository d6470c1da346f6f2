# SPDX-License-Identifier: Apache-2.0
"""The bolls of a plant, from maps to Gaussians."""

from dataclasses import replace

import numpy as np
import pytest
from scenes.boll_scene import CENTRES, RADIUS, cameras, maps_of, masks_of, model

from cotton3dg.cluster.locate_bolls import locate_bolls
from cotton3dg.segment.lint_share import gather_lint

COARSE = 5
"""The boll of the scene that stands lowest."""


@pytest.mark.parametrize("n_gaussians", [1, 3])
def test_a_boll_of_few_gaussians_is_counted_if_all_views_see_it(n_gaussians):
    gaussians, bolls = model()
    rows = np.flatnonzero(bolls == COARSE)
    kept = np.delete(np.arange(len(bolls)), rows[n_gaussians:])
    means, scales = gaussians.means.copy(), gaussians.log_scales.copy()
    means[rows[:n_gaussians]] = CENTRES[COARSE - 1] + 0.05 * RADIUS * np.eye(3)[:n_gaussians]
    scales[rows[:n_gaussians]] = np.log(0.8 * RADIUS)
    gaussians, bolls = replace(gaussians, means=means, log_scales=scales)[kept], bolls[kept]
    rng = np.random.default_rng(0)
    images = masks_of(gaussians, bolls, cameras())
    maps = [maps_of(camera, ids, rng) for camera, ids in zip(cameras(), images, strict=True)]
    shares = gather_lint(maps, cameras(), gaussians, np.ones(len(gaussians), bool))
    located = locate_bolls(maps, cameras(), gaussians, shares, np.array([0.0, 0, 1]))
    assert len(located.bolls) == len(CENTRES)
    lowest = located.bolls[-1]
    assert len(lowest.indices) == n_gaussians
    assert np.linalg.norm(lowest.centre - CENTRES[COARSE - 1]) < 0.2 * RADIUS
    assert not located.left_out
