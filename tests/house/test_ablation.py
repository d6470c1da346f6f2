# SPDX-License-Identifier: Apache-2.0
"""The network without one thing that it says, as the program asks it."""

import numpy as np
from ablation import Lessened, keep_white_things
from scenes.boll_scene import CENTRES, Speaking, cameras, maps_of, masks_of, model, photos_of

from cotton3dg.cluster.locate_bolls import locate_bolls
from cotton3dg.segment.lint_share import gather_lint


def count(photos, network, gaussians) -> int:
    maps = [network.maps(photo) for photo in photos]
    shares = gather_lint(maps, cameras(), gaussians, np.ones(len(gaussians), bool))
    return len(locate_bolls(maps, cameras(), gaussians, shares, np.array([0.0, 0, 1])).bolls)


def test_each_image_is_seen_once():
    gaussians, bolls = model()
    rng = np.random.default_rng(0)
    images = masks_of(gaussians, bolls, cameras())
    maps = [maps_of(camera, ids, rng) for camera, ids in zip(cameras(), images, strict=True)]
    for view, ids in zip(maps, images, strict=True):
        view.lint[ids == 5] = 0.55
    photos, network = photos_of(images), Lessened(Speaking(maps), "")
    as_it_is = count(photos, network, gaussians)
    assert 2 < as_it_is < len(CENTRES)
    assert count(photos, network.without(""), gaussians) == as_it_is
    with keep_white_things():
        assert count(photos, network.without("things"), gaussians) == as_it_is + 1
