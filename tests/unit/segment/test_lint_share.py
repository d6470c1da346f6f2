# SPDX-License-Identifier: Apache-2.0
"""How much each Gaussian is lint."""

import numpy as np
from scenes.boll_scene import CENTRES, cameras, maps_of, masks_of, model

from cotton3dg.segment.lint_share import EDGE, average_lint, gather_lint


def test_bolls_are_lint_by_the_mean_of_all_views():
    gaussians, bolls = model()
    rng = np.random.default_rng(0)
    seen = [
        maps_of(camera, ids, rng) for camera, ids in zip(cameras(), masks_of(gaussians, bolls, cameras()), strict=True)
    ]
    means = average_lint(seen, cameras(), gaussians)
    one = average_lint(seen[:1], cameras()[:1], gaussians)
    assert means[bolls > 0].mean() > 0.5 > means[bolls == 0].mean()
    assert not np.allclose(one, means)
    left = gaussians.means[:, 0] < CENTRES[:, 0].mean()
    shares = gather_lint(seen, cameras(), gaussians, left)
    assert not shares[~left].any()
    np.testing.assert_array_equal(shares[left] > 0.5, means[left] > EDGE)
