# SPDX-License-Identifier: Apache-2.0
"""Hard cases 30 to 35: degenerate point sets, boxes, clusters, planes and scales."""

import json

import numpy as np
import pytest
from scenes.table_scene import POSE, Pose, gaussians_at, orbit, table_points_cm

from cotton3dg.cluster.dbscan import cluster_objects
from cotton3dg.core.bolls import BollInstance, BollSelection, LiftedMasks
from cotton3dg.core.scene import Camera
from cotton3dg.errors import BadInput
from cotton3dg.geometry.boxes import fibonacci_directions, min_area_rectangle, oriented_box
from cotton3dg.geometry.convex_measures import alpha_volume, calliper_diameter, convex_volume
from cotton3dg.scale.table import NoTable, TableFit, find_table, scale_from_table
from cotton3dg.schemas.scale import read_scale
from cotton3dg.traits.boll_volume import measure_bolls
from cotton3dg.traits.measure import summarise_plant

BALL = fibonacci_directions(400)
RNG = np.random.default_rng(0)
DEGENERATE = {
    "too_few_points": RNG.normal(size=(3, 3)),
    "coincident_points": np.full((50, 3), 1.7),
    "collinear_points": RNG.normal(size=(50, 1)) * [1.0, 2.0, 3.0] + 5,
    "flat_points": RNG.normal(size=(50, 2)) @ RNG.normal(size=(2, 3)) + 5,
    "not_finite": np.where(np.arange(60).reshape(20, 3) == 7, np.nan, RNG.normal(size=(20, 3))),
}
CAMERAS = orbit(20, 320, 180)


@pytest.mark.parametrize("reason", DEGENERATE)
@pytest.mark.parametrize("measure", [convex_volume, lambda p: alpha_volume(p, 0.5), calliper_diameter])
def test_case_30_degenerate_sets_have_a_reason_and_no_volume(reason, measure):
    value, why = measure(DEGENERATE[reason])
    assert np.isnan(value)
    assert why == reason


def test_case_30_empty_set():
    assert convex_volume(np.zeros((0, 3))).reason == "too_few_points"


def test_case_30_flat_in_float32_is_flat():
    plate = (RNG.uniform(size=(300, 3)) * [1, 1, 0] + [10, 20, 3]).astype(np.float32)
    assert convex_volume(plate).reason == "flat_points"


def test_case_30_duplicates_do_not_change_a_volume():
    assert convex_volume(np.repeat(BALL, 3, axis=0)).value == pytest.approx(convex_volume(BALL).value, rel=1e-9)
    assert alpha_volume(np.repeat(BALL, 3, axis=0), 0.4).value == pytest.approx(alpha_volume(BALL, 0.4).value, rel=1e-6)


def test_case_30_the_blank_cell_says_why():
    boll = BollInstance(1, np.arange(3), ("a",), np.zeros(3), 0.1, 0.5)
    none = BollInstance(2, np.zeros(0, np.int64), ("a",), np.zeros(3), 0.1, 0.5)
    faint = gaussians_at(RNG.normal(size=(3, 3)), 0.1, opacity=0.01)
    traits = measure_bolls(faint, [boll, none], scale(), np.zeros(3))
    assert [np.isnan(t.volume_cm3) for t in traits] == [True, True]
    assert [t.flags for t in traits] == [("too_few_points",), ("too_few_points",)]
    assert summarise_plant(traits, None, scale()).flags == ("bolls_without_volume", "doubtful_bolls")


def test_case_31_volume_far_from_the_origin():
    near, far = BALL, BALL + [1e6, -2e6, 3e6]
    assert convex_volume(far).value == pytest.approx(convex_volume(near).value, rel=1e-8)
    assert alpha_volume(far, 0.4).value == pytest.approx(alpha_volume(near, 0.4).value, rel=1e-6)
    in_float32 = (BALL + 1000.0).astype(np.float32)
    assert convex_volume(in_float32).value == pytest.approx(convex_volume(near).value, rel=1e-4)


def test_case_31_volume_scales_with_the_cube():
    for factor in (1e-6, 1e6):
        assert convex_volume(BALL * factor).value == pytest.approx(convex_volume(BALL).value * factor**3, rel=1e-9)


@pytest.mark.parametrize(
    ("points", "sides", "tie"),
    [
        (BALL, [2, 2, 2], True),
        (np.array([[x, y, 0] for x in (0, 4) for y in (0, 1)], float), [4, 1, 0], False),
        (np.outer(np.linspace(0, 1, 9), [2, 0, 0]), [2, 0, 0], True),
        (np.ones((5, 3)), [0, 0, 0], True),
    ],
    ids=["sphere", "plate", "line", "point"],
)
def test_case_32_boxes_of_symmetric_and_flat_sets(points, sides, tie):
    box = oriented_box(points)
    assert box.sides == pytest.approx(sides, abs=0.02)
    assert box.tie == tie
    assert np.linalg.det(box.axes) == pytest.approx(1.0)
    assert (np.diff(box.sides) <= 0).all()


def test_case_32_rectangles_of_flat_sets():
    line = min_area_rectangle(np.outer(np.arange(5.0), [3, 4]))
    assert line.sides == pytest.approx([20, 0], abs=1e-9)
    assert min_area_rectangle(np.ones((1, 2))).sides.tolist() == [0, 0]
    assert min_area_rectangle(np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])).tie


def lifted(n, groups):
    """Masks that each select the rows of one of `groups` in each of two views."""
    views = ("a.jpg", "b.jpg")
    selections = tuple(
        BollSelection(view, mask, np.sort(rows), np.ones(len(rows), np.float32))
        for view in views
        for mask, rows in enumerate(groups, 1)
    )
    return LiftedMasks("", views, np.arange(n), np.ones(n, np.float32), np.ones((2, n), np.float32), selections)


def test_case_33_clustering_nothing_gives_no_bolls():
    assert cluster_objects(lifted(0, []), np.zeros((0, 3), np.float32), np.array([0, 0, 1.0])) == []
    assert cluster_objects(lifted(50, []), np.zeros((50, 3), np.float32), np.array([0, 0, 1.0])) == []


def test_case_33_one_point_is_no_boll_and_no_error():
    assert cluster_objects(lifted(1, [np.array([0])]), np.zeros((1, 3), np.float32), np.array([0, 0, 1.0])) == []


def test_case_33_another_order_of_gaussians_and_masks_gives_the_same_bolls():
    means = np.concatenate([BALL + [4 * k, 0, k] for k in range(3)]).astype(np.float32)
    groups = np.split(np.arange(1200), 3)
    order = np.random.default_rng(5).permutation(1200)
    place = np.argsort(order)
    up = np.array([0, 0, 1.0])
    straight = cluster_objects(lifted(1200, groups), means, up)
    shuffled = cluster_objects(lifted(1200, [place[rows] for rows in groups[::-1]]), means[order], up)
    assert len(straight) == 3
    for one, other in zip(straight, shuffled, strict=True):
        assert one.boll_id == other.boll_id
        assert set(order[other.indices]) == set(one.indices)
        assert other.centre == pytest.approx(one.centre, abs=1e-5)


def test_case_34_two_points_are_no_plane():
    for n in (0, 1, 2, 29):
        assert isinstance(find_table(POSE.scene(RNG.normal(size=(n, 3))), CAMERAS), NoTable)


def test_case_34_not_finite_points_are_left_out():
    points = POSE.scene(table_points_cm(np.random.default_rng(0)))
    poisoned = np.vstack([points, np.full((50, 3), np.nan), np.full((5, 3), np.inf)])
    clean, found = (find_table(p, CAMERAS).rectangle.corners for p in (points, poisoned))
    assert found == pytest.approx(clean, abs=1e-9)


def test_case_34_of_two_tables_the_higher_one_is_taken():
    rng = np.random.default_rng(0)
    upper = rng.uniform([-60, -30, 0], [60, 30, 0], (4000, 3))
    lower = rng.uniform([-60, -30, -30], [60, 30, -30], (4000, 3))
    noise = rng.normal(0, 0.1, (8000, 3))
    fits = [
        find_table(POSE.scene(np.vstack(pair) + noise), CAMERAS, seed=seed)
        for seed, pair in enumerate([(upper, lower), (lower, upper), (lower, upper)])
    ]
    for fit in fits:
        assert isinstance(fit, TableFit)
        assert np.abs(POSE.cm(fit.rectangle.corners)[:, 2]).max() < 0.5


def test_case_34_a_grid_of_exact_ties_is_decided_the_same_way_each_time():
    x, y = np.meshgrid(np.arange(-60, 60.1, 1.5), np.arange(-30, 30.1, 1.5))
    grid = POSE.scene(np.stack([x, y, 0 * x], -1).reshape(-1, 3))
    first, second = (find_table(grid, CAMERAS).rectangle.corners for _ in range(2))
    assert first.tobytes() == second.tobytes()
    assert np.abs(POSE.cm(first)) == pytest.approx(np.tile([60, 30, 0], (4, 1)), abs=2.7)


def test_case_34_cameras_all_in_one_place():
    same = [Camera(f"{k}", 320, 180, 250, 250, 160, 90, CAMERAS[0].cam_from_scene) for k in range(5)]
    assert isinstance(find_table(POSE.scene(table_points_cm(np.random.default_rng(0))), same), NoTable)


def test_case_35_a_table_without_area_gives_no_scale():
    line = RNG.uniform([-60, 0, 0], [60, 0.2, 0], (4000, 3))
    found = find_table(POSE.scene(line), CAMERAS)
    assert isinstance(found, NoTable)
    assert found.reason


def test_case_35_absurd_units_stay_finite():
    for factor in (1e-6, 1e6):
        pose = Pose(POSE.cm_per_su * factor, POSE.rotation, POSE.shift)
        points = pose.scene(table_points_cm(np.random.default_rng(0)))
        found = scale_from_table(find_table(points, orbit(20, 320, 180, pose=pose)), 120, 60)
        assert found.cm_per_su == pytest.approx(pose.cm_per_su, rel=0.02)


@pytest.mark.parametrize("value", [0.0, -1.0, None, 1e400, "wide"])
def test_case_35_a_scale_file_without_a_usable_scale_is_refused(tmp_path, value):
    facts = {"source": "table", "cm_per_su": value, "relative_error": 0.1, "up": [0, 0, 1], "plane": [0, 0, 1, 0],
             "corners": [[0, 0, 0]] * 4}  # fmt: skip
    path = tmp_path / "scale.json"
    path.write_text(json.dumps(facts))
    with pytest.raises(BadInput, match=r"scale\.json"):
        read_scale(path)


def scale():
    points = POSE.scene(table_points_cm(np.random.default_rng(0)))
    return scale_from_table(find_table(points, CAMERAS), 120, 60)
