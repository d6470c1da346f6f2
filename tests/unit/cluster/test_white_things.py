# SPDX-License-Identifier: Apache-2.0
"""What is white but no boll."""

import itertools

import numpy as np
import pytest
from scenes.boll_scene import CENTRES, RADIUS, cameras, maps_of, masks_of, model

from cotton3dg.cluster.locate_bolls import locate_bolls
from cotton3dg.cluster.white_things import find_white_things, measure_surroundings
from cotton3dg.segment.lint_share import gather_lint

OF_THING = 5
"""The boll of the scene that stands lowest."""


def scene(lint_of_thing: float, plant_beside_thing: float):
    """What the network says of images, and true ids; beside all other bolls half of what is seen is bur."""
    gaussians, bolls = model()
    rng = np.random.default_rng(0)
    images = masks_of(gaussians, bolls, cameras())
    maps = [maps_of(camera, ids, rng) for camera, ids in zip(cameras(), images, strict=True)]
    for view, ids, camera in zip(maps, images, cameras(), strict=True):
        columns, rows = np.meshgrid(np.arange(ids.shape[1]), np.arange(ids.shape[0]))
        nearest = np.linalg.norm(np.stack([columns, rows], -1)[..., None, :] - camera.project(CENTRES)[0], axis=-1)
        bur = np.where(nearest.argmin(axis=-1) + 1 == OF_THING, plant_beside_thing, 0.5)
        view.probabilities[2] = np.where(ids == 0, bur, 0)
        view.lint[ids == OF_THING] = lint_of_thing
        view.probabilities[0] = 1 - view.probabilities[1:].sum(axis=0)
    return maps, gaussians, images


@pytest.mark.parametrize(
    "lint, plant, kept",
    [(0.7, 0.02, False), (0.7, 0.5, True), (0.55, 0.5, False), (0.9, 0.02, True)],
    ids=["less sure, no plant", "less sure, on a plant", "hardly sure, on a plant", "as sure, no plant"],
)
def test_what_the_network_is_less_sure_of_is_a_boll_only_on_a_plant(lint, plant, kept):
    maps, gaussians, true = scene(lint, plant)
    shares = gather_lint(maps, cameras(), gaussians, np.ones(len(gaussians), bool))
    located = locate_bolls(maps, cameras(), gaussians, shares, np.array([0.0, 0, 1]))
    of_thing = np.concatenate([located.images[c.name][ids == OF_THING] for c, ids in zip(cameras(), true, strict=True)])
    assert ((of_thing > 0).mean() > 0.9) == kept
    assert kept or (of_thing > 0).mean() < 0.01
    of_others = np.concatenate(
        [located.images[c.name][(ids > 0) & (ids < OF_THING)] for c, ids in zip(cameras(), true, strict=True)]
    )
    assert (of_others > 0).mean() > 0.9
    # Half of the twelve views may or may not tell the two apart that touch.
    assert located.halves in {(3 + kept,) * 2, (4 + kept,) * 2}
    for boll in located.bolls:
        assert boll.masks == tuple((name, boll.boll_id) for name in boll.views)
        assert all((located.images[name] == boll.boll_id).any() for name in boll.views)
    assert [boll.boll_id for boll in located.bolls] == list(range(1, len(located.bolls) + 1))
    assert all(a.centre[2] >= b.centre[2] for a, b in itertools.pairwise(located.bolls))
    # What does not count is said all the same.
    assert [thing.reason for thing in located.left_out] == ["white_thing"] * (not kept)
    assert kept or np.linalg.norm(located.left_out[0].centre_su - CENTRES[OF_THING - 1]) < 0.2 * RADIUS


def test_a_network_that_knows_no_plants_is_not_asked_for_them():
    on_and_beside = np.array([[90, 100, 0.4, 40], [90, 100, 0.4, 40], [70, 100, 0.0, 40]])
    support = np.full(3, 0.5, np.float32)
    assert not find_white_things(on_and_beside, support).any()
    on_and_beside[:2, 2] = 8
    assert find_white_things(on_and_beside, support).tolist() == [False, False, True]
    on_and_beside[2, 0] = 80
    assert not find_white_things(on_and_beside, support).any()


def test_sums_are_of_what_is_on_and_beside_each_boll():
    maps, _, images = scene(0.6, 0.1)
    sums = measure_surroundings(maps[0], images[0], 6)
    for boll in range(1, 6):
        on = images[0] == boll
        assert sums[boll - 1, 1] == on.sum()
        assert sums[boll - 1, 0] == pytest.approx((0.6 if boll == OF_THING else 0.9) * on.sum(), rel=1e-4)
    assert sums[OF_THING - 1, 2] / sums[OF_THING - 1, 3] == pytest.approx(0.1, abs=0.05)
    assert sums[0, 2] / sums[0, 3] == pytest.approx(0.5, abs=0.01)
    assert not sums[5].any()


def test_without_bolls_there_are_no_things():
    assert not find_white_things(np.zeros((0, 4)), np.zeros(0, np.float32)).any()
    assert not find_white_things(np.zeros((3, 4)), np.ones(3, np.float32)).any()
