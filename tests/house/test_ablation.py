"""The network without one thing that it says, as the program asks it."""

import numpy as np
from ablation import Lessened, keep_white_things
from scenes.boll_scene import CENTRES, Speaking, cameras, maps_of, masks_of, model, photos_of

from cotton3dg.masks.detect_bolls import detect_bolls


def count(masks) -> int:
    return len(np.unique(np.concatenate([ids[ids > 0] for ids in masks.ids.values()])))


def test_each_image_is_seen_once():
    gaussians, bolls = model()
    rng = np.random.default_rng(0)
    images = masks_of(gaussians, bolls, cameras())
    maps = [maps_of(camera, ids, rng) for camera, ids in zip(cameras(), images, strict=True)]
    for view, ids in zip(maps, images, strict=True):
        view.lint[ids == 5] = 0.55
    photos, network = photos_of(images), Lessened(Speaking(maps), "")
    as_it_is = count(detect_bolls(photos, cameras(), network, gaussians))
    assert 2 < as_it_is < len(CENTRES)
    assert count(detect_bolls(photos, cameras(), network.without(""), gaussians)) == as_it_is
    with keep_white_things():
        assert count(detect_bolls(photos, cameras(), network.without("things"), gaussians)) == as_it_is + 1
