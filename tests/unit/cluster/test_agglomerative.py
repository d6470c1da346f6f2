from dataclasses import replace

import numpy as np
from scenes.view_masks import UP, ball, lifted_balls

from cotton3dg.cluster.agglomerative import join_objects


def test_objects_of_different_views_join_and_those_of_one_view_never():
    rng = np.random.default_rng(0)
    # 0.9 apart, within reach = 0.6 widths of 2: distance alone would join all four masks.
    balls = [ball(rng, 200, (0, 0, 0)), ball(rng, 200, (0.9, 0, 0))]
    means, lifted = lifted_balls(balls, [[[0], [1]], [[1], [0]]])
    bolls = join_objects(lifted, means, UP)
    assert len(bolls) == 2
    assert sorted(round(float(boll.centre[0]), 1) for boll in bolls) == [0.0, 0.9]
    assert all(boll.views == ("0.jpg", "1.jpg") and boll.confidence == 1.0 for boll in bolls)


def test_views_do_not_leak_through_a_chain():
    rng = np.random.default_rng(1)
    # Views 0 and 2 both see balls 0 and 2; ball 1 between them is seen by view 1 alone and is near to both.
    balls = [ball(rng, 200, (x, 0, 0)) for x in (0, 0.7, 1.4)]
    means, lifted = lifted_balls(balls, [[[0], [2]], [[1]], [[0], [2]]])
    bolls = join_objects(lifted, means, UP)
    assert len(bolls) == 2
    assert all(len(set(boll.views)) == len(boll.views) for boll in bolls)


def test_distant_objects_and_those_beyond_the_cap_stay_apart():
    rng = np.random.default_rng(2)
    balls = [ball(rng, 200, (0, 0, 0)), ball(rng, 200, (0, 0, 9)), ball(rng, 200, (0, 0, 11))]
    means, lifted = lifted_balls(balls, [[[0], [1], [2]], [[0], [1], [2]], [[1, 2]]])
    bolls = join_objects(lifted, means, UP)
    assert [round(float(boll.centre[2])) for boll in bolls] == [11, 9, 0]
    assert [boll.boll_id for boll in bolls] == [1, 2, 3]


def test_nothing_one_view_and_crumbs_make_no_boll():
    rng = np.random.default_rng(3)
    means, lifted = lifted_balls([ball(rng, 200, (0, 0, 0)), ball(rng, 9, (9, 0, 0))], [[[0], [1]], [[1]]])
    assert join_objects(lifted, means, UP) == []
    assert join_objects(replace(lifted, selections=()), means, UP) == []


def test_the_order_of_masks_is_of_no_consequence():
    rng = np.random.default_rng(4)
    balls = [ball(rng, 100, (x, 0, 0)) for x in (0, 1.1, 2.3, 5)]
    means, lifted = lifted_balls(balls, [[[0], [1], [2], [3]], [[3], [2], [0]], [[1], [3], [0]]])
    expected = join_objects(lifted, means, UP)
    found = join_objects(replace(lifted, selections=lifted.selections[::-1]), means, UP)
    assert len(expected) == 4
    assert [b.indices.tolist() for b in found] == [b.indices.tolist() for b in expected]
