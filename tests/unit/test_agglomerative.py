from dataclasses import replace

import numpy as np

from cotton3dg.clustering.agglomerative import cluster_objects
from cotton3dg.core.bolls import BollSelection, LiftedMasks

UP = np.array([0, 0, 1.0])


def ball(rng, n, centre):
    directions = rng.normal(size=(n, 3))
    return np.array(centre) + directions / np.linalg.norm(directions, axis=1, keepdims=True)


def made(balls, views):
    """One mask a ball in every view that lists it; each view sees all Gaussians with 1 px."""
    rows = np.split(np.arange(sum(map(len, balls))), np.cumsum([len(b) for b in balls])[:-1])
    names = tuple(f"{k}.jpg" for k in range(len(views)))
    selections = tuple(
        BollSelection(
            name, mask, np.concatenate([rows[k] for k in group]), np.ones(sum(len(rows[k]) for k in group), np.float32)
        )
        for name, groups in zip(names, views, strict=True)
        for mask, group in enumerate(groups, 1)
    )
    means = np.concatenate(balls).astype(np.float32)
    n = len(means)
    return means, LiftedMasks(
        "", names, np.arange(n), np.ones(n, np.float32), np.ones((len(views), n), np.float32), selections
    )


def test_objects_of_different_views_join_and_those_of_one_view_never():
    rng = np.random.default_rng(0)
    # 0.9 apart, within eps = 0.6 widths of 2: distance alone would join all four masks.
    balls = [ball(rng, 200, (0, 0, 0)), ball(rng, 200, (0.9, 0, 0))]
    means, lifted = made(balls, [[[0], [1]], [[1], [0]]])
    bolls = cluster_objects(lifted, means, UP)
    assert len(bolls) == 2
    assert sorted(round(float(boll.centre[0]), 1) for boll in bolls) == [0.0, 0.9]
    assert all(boll.views == ("0.jpg", "1.jpg") and boll.confidence == 1.0 for boll in bolls)


def test_views_do_not_leak_through_a_chain():
    rng = np.random.default_rng(1)
    # Views 0 and 2 both see balls 0 and 2; ball 1 between them is seen by view 1 alone and is near to both.
    balls = [ball(rng, 200, (x, 0, 0)) for x in (0, 0.7, 1.4)]
    means, lifted = made(balls, [[[0], [2]], [[1]], [[0], [2]]])
    bolls = cluster_objects(lifted, means, UP)
    assert len(bolls) == 2
    assert all(len(set(boll.views)) == len(boll.views) for boll in bolls)


def test_distant_objects_and_those_beyond_the_cap_stay_apart():
    rng = np.random.default_rng(2)
    balls = [ball(rng, 200, (0, 0, 0)), ball(rng, 200, (0, 0, 9)), ball(rng, 200, (0, 0, 11))]
    means, lifted = made(balls, [[[0], [1], [2]], [[0], [1], [2]], [[1, 2]]])
    bolls = cluster_objects(lifted, means, UP)
    assert [round(float(boll.centre[2])) for boll in bolls] == [11, 9, 0]
    assert [boll.boll_id for boll in bolls] == [1, 2, 3]


def test_nothing_one_view_and_crumbs_make_no_boll():
    rng = np.random.default_rng(3)
    means, lifted = made([ball(rng, 200, (0, 0, 0)), ball(rng, 9, (9, 0, 0))], [[[0], [1]], [[1]]])
    assert cluster_objects(lifted, means, UP) == []
    assert cluster_objects(replace(lifted, selections=()), means, UP) == []


def test_the_order_of_masks_is_of_no_consequence():
    rng = np.random.default_rng(4)
    balls = [ball(rng, 100, (x, 0, 0)) for x in (0, 1.1, 2.3, 5)]
    means, lifted = made(balls, [[[0], [1], [2], [3]], [[3], [2], [0]], [[1], [3], [0]]])
    expected = cluster_objects(lifted, means, UP)
    found = cluster_objects(replace(lifted, selections=lifted.selections[::-1]), means, UP)
    assert len(expected) == 4
    assert [b.indices.tolist() for b in found] == [b.indices.tolist() for b in expected]
