# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scenes.view_masks import UP, ball, lifted_balls

from cotton3dg.cluster.dbscan import cluster_objects, drop_large, find_clusters, part_cluster
from cotton3dg.cluster.view_objects import ViewObject


def item(view, rows):
    return ViewObject(view, np.asarray(rows), np.ones(len(rows), np.float32))


def row_of_points(*starts):
    """Ten points at whole steps along x from each start."""
    x = np.concatenate([start + np.arange(10.0) for start in starts])
    return np.column_stack([x, np.zeros((len(x), 2))])


@pytest.mark.parametrize(("second", "clusters"), [(10, [0, 0]), (11, [0, 1]), (12, [0, 1])])
def test_objects_are_connected_through_core_points_within_eps(second, clusters):
    """By hand, eps 1.05, min_samples 3: points between two neighbours are core; steps of 1 connect, of 2 not."""
    points = row_of_points(0, second)
    members = find_clusters([item(0, range(10)), item(1, range(10, 20))], points, 1.05, min_samples=3)
    assert [member.cluster for member in members] == clusters
    assert all(len(member.item.rows) == 10 for member in members)


def test_points_with_too_few_neighbours_are_noise():
    points = np.vstack([row_of_points(0, 0), [[0.0, 3.0, 0.0]]])
    # Each step holds two points, so that four or six lie within 1.05; the lone one above is noise.
    members = find_clusters([item(0, [*range(10), 20]), item(1, range(10, 20))], points, 1.05, min_samples=6)
    assert [member.item.rows.tolist() for member in members] == [list(range(10)), list(range(10, 20))]
    # Between two steps lie six points; seven there are nowhere.
    assert find_clusters([item(0, [*range(10), 20]), item(1, range(10, 20))], points, 1.05, min_samples=7) == []


def test_objects_of_one_view_are_never_one_boll():
    rng = np.random.default_rng(0)
    # In touch, so that DBSCAN alone would make one cluster of all four masks.
    means, lifted = lifted_balls([ball(rng, 200, (0, 0, 0)), ball(rng, 200, (1.9, 0, 0))], [[[0], [1]], [[1], [0]]])
    bolls = cluster_objects(lifted, means, UP)
    assert sorted(round(float(boll.centre[0]), 1) for boll in bolls) == [0.0, 1.9]
    assert all(boll.views == ("0.jpg", "1.jpg") and boll.confidence == 1.0 for boll in bolls)


def test_a_shared_view_parts_a_cluster_at_the_nearest_centres():
    """By hand: of three objects in a row, at 0, 10 and 21, the first and last of one view, the first two are nearer."""
    points = row_of_points(0, 10, 21)
    objects = [item(0, range(10)), item(1, range(10, 20)), item(0, range(20, 30))]
    groups = part_cluster(objects, points, eps_su=2.05)
    assert [[int(each.rows[0]) for each in group] for group in groups] == [[0, 10], [20]]


def test_what_is_not_within_eps_joins_nothing_in_a_parted_cluster():
    points = row_of_points(0, 10, 30)
    objects = [item(0, range(10)), item(0, range(10, 20)), item(1, range(20, 30))]
    assert len(part_cluster(objects, points, eps_su=2.0)) == 3


def test_a_boll_of_a_single_view_stays():
    rng = np.random.default_rng(1)
    means, lifted = lifted_balls([ball(rng, 200, (0, 0, 0)), ball(rng, 200, (9, 0, 0))], [[[0], [1]], [[0]], [[0]], []])
    bolls = {round(float(boll.centre[0])): boll for boll in cluster_objects(lifted, means, UP)}
    assert bolls[0].views == ("0.jpg", "1.jpg", "2.jpg")
    assert bolls[9].views == ("0.jpg",)
    assert bolls[9].confidence == pytest.approx(1 / 4)


def test_an_object_with_too_large_a_hull_is_left_out():
    """By hand: hulls of 8, 8, 8 and 25 have the median 8, and 25 is more than three times that."""
    cube = np.array(np.meshgrid([0, 2.0], [0, 2.0], [0, 2.0])).reshape(3, -1).T
    points = np.vstack([cube, cube + 10, cube + 20, cube * [3.125, 1, 1] + 30])
    objects = [item(k, range(8 * k, 8 * k + 8)) for k in range(4)]
    assert drop_large(objects, points) == objects[:3]
    assert drop_large([item(0, [0, 1, 2])], points) == []


def test_nothing_and_crumbs_make_no_boll():
    rng = np.random.default_rng(3)
    means, lifted = lifted_balls([ball(rng, 9, (0, 0, 0))], [[[0]], [[0]]])
    assert cluster_objects(lifted, means, UP) == []
