# SPDX-License-Identifier: Apache-2.0
"""Scales from the table's sections and from picked points, triangulation, and what several references say together."""

import numpy as np
import pytest
from scenes.table_scene import POSE, orbit, table_points_cm

from cotton3dg.errors import BadInput
from cotton3dg.geometry.camera_orbit import fit_orbit
from cotton3dg.geometry.triangulation import triangulate
from cotton3dg.io.picks import read_picks
from cotton3dg.scale.rectangle import Rectangle
from cotton3dg.scale.references import NoReference, Reference, distance_ratios, find_ground, reconcile, scale_on
from cotton3dg.scale.sections import (
    cut_table,
    draw_sections,
    scale_from_all_sections,
    scale_from_central_section,
)
from cotton3dg.scale.two_points import scale_from_distance

CAMERAS = orbit(20, 320, 180)
TABLE = Rectangle(POSE.rotation.T, POSE.scene(np.zeros((1, 3)))[0], np.array([-60, 60, -30, 30]) / POSE.cm_per_su)


def test_a_point_is_found_where_most_views_see_it():
    point = POSE.scene(np.array([[10.0, -5.0, 30.0]]))[0]
    rng = np.random.default_rng(0)
    pixels = np.array([camera.project(point[None])[0][0] for camera in CAMERAS]) + rng.normal(0, 0.2, (20, 2))
    pixels[[3, 8, 12]] += 25.0
    sighting = triangulate(CAMERAS, pixels)
    assert sighting.point == pytest.approx(point, abs=0.1 / POSE.cm_per_su)
    assert np.flatnonzero(~sighting.agreeing).tolist() == [3, 8, 12]
    assert sighting.residual_px == pytest.approx(0.28, abs=0.1)


def test_views_that_do_not_meet_give_no_point():
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0, 180, (20, 2))
    assert triangulate(CAMERAS, pixels) is None
    assert triangulate(CAMERAS[:1], pixels[:1]) is None
    # The same camera twice tells no depth.
    assert triangulate([CAMERAS[0]] * 2, pixels[[0, 0]]) is None


def test_the_error_of_a_point_is_what_its_scatter_predicts():
    point = POSE.scene(np.array([[0.0, 0.0, 20.0]]))[0]
    clean = np.array([camera.project(point[None])[0][0] for camera in CAMERAS])
    rng = np.random.default_rng(1)
    found = [triangulate(CAMERAS, clean + rng.normal(0, 0.3, clean.shape), tolerance_px=3.0) for _ in range(40)]
    scatter = np.sqrt(np.mean([np.mean((sighting.point - point) ** 2) for sighting in found]))
    assert 0.3 * found[0].su_per_px == pytest.approx(scatter, rel=0.3)


def test_all_sections_give_the_scale_of_the_points():
    points = POSE.scene(table_points_cm(np.random.default_rng(0), 8000))
    found = scale_from_all_sections(points, TABLE, 120, 60, fit_orbit(CAMERAS).radius)
    assert isinstance(found, Reference)
    assert found.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.015)
    assert found.relative_error < 0.02


def test_all_sections_of_another_shape_or_of_nothing_are_refused():
    points = POSE.scene(table_points_cm(np.random.default_rng(0), 8000))
    radius = fit_orbit(CAMERAS).radius
    assert "disagree" in scale_from_all_sections(points, TABLE, 120, 90, radius).reason
    assert "few points" in scale_from_all_sections(points[:50], TABLE, 120, 60, radius).reason


def waisted_table() -> tuple[np.ndarray, Rectangle]:
    """A cloud 13 su long, 6 su wide in the central one of 11 sections and 6.1 su elsewhere, on its plane."""
    x, y = np.meshgrid(np.linspace(-6.5, 6.5, 1101), np.linspace(-1, 1, 61))
    half = np.where(np.abs(x) < 6.5 / 11 + 1e-9, 3.0, 3.05)
    cloud = np.column_stack([x.ravel(), (half * y).ravel(), np.zeros(x.size)])
    return cloud, Rectangle(np.eye(3), np.zeros(3), np.array([-6.5, 6.5, -3.0, 3.0]))


def test_the_central_section_alone_gives_the_papers_scale():
    """By hand: L = 6 su is the table's width, so that β = 6 / 60 and 10 cm are one su; 13 su of length say nothing."""
    cloud, table = waisted_table()
    found = scale_from_central_section(cut_table(cloud, table, radius=13.0), width_cm=60)
    assert found.source == "sections"
    assert found.cm_per_su == pytest.approx(10.0, rel=1e-9)
    # Ten of eleven sections are 6.1 / 6 as long: their median deviation is that.
    assert found.relative_error == pytest.approx(1.4826 * 0.1 / 6, rel=1e-6)
    # The mean over both sides would be led astray by the wrong length.
    assert isinstance(scale_from_all_sections(cloud, table, 120, 60, 13.0), Reference)
    assert scale_from_all_sections(cloud, table, 120, 60, 13.0).cm_per_su < 9.7


def test_sections_of_a_scattered_cloud_give_the_scale():
    points = POSE.scene(table_points_cm(np.random.default_rng(0), 8000))
    cut = cut_table(points, TABLE, fit_orbit(CAMERAS).radius)
    found = scale_from_central_section(cut, 60)
    assert found.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.02)
    picture = draw_sections(cut)
    assert picture.shape[1] == 960
    assert picture.shape[0] == pytest.approx(480, rel=0.1)
    assert (picture == (220, 120, 0)).all(axis=2).any()


def test_sections_without_points_are_refused():
    cloud, table = waisted_table()
    assert "few points" in cut_table(cloud[:10], table, 13.0).reason
    holed = cloud[np.abs(cloud[:, 0]) > 6.5 / 11]
    assert "middle of the table" in scale_from_central_section(cut_table(holed, table, 13.0), 60).reason
    narrow = cloud * np.where(np.abs(cloud[:, :1]) < 6.5 / 11, [1, 0.8, 1], 1)
    assert isinstance(scale_from_central_section(cut_table(narrow, table, 13.0), 60), NoReference)


def picks_of(points_cm, views=(0, 4, 9), error_px=0.0):
    rng = np.random.default_rng(0)
    return {
        name: {
            CAMERAS[v].name: CAMERAS[v].project(POSE.scene(point[None]))[0][0] + rng.normal(0, error_px, 2)
            for v in views
        }
        for name, point in zip("ab", np.asarray(points_cm, float), strict=True)
    }


def test_two_picked_points_give_the_scale():
    points = np.array([[-60, -30, 0], [60, -30, 0]])
    reference, places = scale_from_distance(CAMERAS, picks_of(points), 120.0)
    assert reference.cm_per_su == pytest.approx(POSE.cm_per_su, rel=1e-6)
    assert POSE.cm(places) == pytest.approx(points, abs=1e-3)
    assert 0.001 <= reference.relative_error < 0.01
    rough, _ = scale_from_distance(CAMERAS, picks_of(points, error_px=0.7), 120.0)
    assert rough.cm_per_su == pytest.approx(POSE.cm_per_su, rel=3 * rough.relative_error)


def test_picks_that_say_little_are_refused():
    points = np.array([[-60, -30, 0], [60, -30, 0]])
    assert "where two are needed" in scale_from_distance(CAMERAS, {"a": {}}, 120.0).reason
    one = picks_of(points) | {"b": {CAMERAS[0].name: np.array([3.0, 4.0])}}
    assert "1 of the placed images" in scale_from_distance(CAMERAS, one, 120.0).reason
    slip = picks_of(points)
    slip["b"][CAMERAS[4].name] = slip["b"][CAMERAS[4].name] + 40.0
    slip["b"][CAMERAS[9].name] = slip["b"][CAMERAS[9].name] - 40.0
    assert "do not meet" in scale_from_distance(CAMERAS, slip, 120.0).reason
    close = np.array([[0, 0, 0], [4.0, 0, 0]])
    assert "more images" in scale_from_distance(CAMERAS, picks_of(close), 4.0).reason


def test_references_that_agree_are_averaged_by_their_certainty():
    together = reconcile([Reference("table", 40.0, 0.004), Reference("aruco", 40.2, 0.002)])
    assert together.cm_per_su == pytest.approx((40.0 / 16 + 40.2 / 4) / (1 / 16 + 1 / 4))
    assert together.agreeing == ("aruco", "table")
    assert together.differing == {}
    assert together.relative_error == pytest.approx(0.1 / 40.16, rel=1e-3)


def test_a_reference_of_wrong_size_is_left_out_and_named():
    together = reconcile(
        [Reference("table", 44.0, 0.003), Reference("aruco", 40.0, 0.002), Reference("distance", 40.1, 0.01)]
    )
    assert together.agreeing == ("aruco", "distance")
    assert together.cm_per_su == pytest.approx(40.0, rel=0.002)
    assert together.differing == {"table": pytest.approx(0.1)}


def test_what_was_measured_outvotes_what_was_assumed():
    table = Reference("table", 44.0, 0.002, assumed=True)
    together = reconcile([table, Reference("card", 40.0, 0.01)])
    assert (together.agreeing, together.assumed) == (("card",), False)
    assert together.differing == {"table": pytest.approx(0.1)}
    assert reconcile([table]).assumed
    assert not reconcile([table, Reference("card", 44.1, 0.002)]).assumed  # it confirms the size


def test_a_rough_reference_does_not_disagree_with_a_sure_one():
    together = reconcile([Reference("table", 40.0, 0.002), Reference("sections", 41.0, 0.015)])
    assert together.differing == {}
    assert together.cm_per_su == pytest.approx(40.0, rel=0.001)


def test_the_ground_is_the_table_top_or_else_the_floor():
    cloud = table_points_cm(np.random.default_rng(0))
    ground = find_ground(POSE.scene(cloud), CAMERAS)
    scale = scale_on(ground, POSE.cm_per_su, 0.01, "aruco")
    assert scale.height_cm(POSE.scene(np.array([[0, 0, 25.0]]))) == pytest.approx([25.0], abs=0.5)
    no_table = cloud[(np.abs(cloud[:, :2]) > [61, 31]).any(axis=1)]
    floor = find_ground(POSE.scene(no_table), CAMERAS)
    scale = scale_on(floor, POSE.cm_per_su, 0.01, "aruco")
    assert scale.height_cm(POSE.scene(np.zeros((1, 3)))) == pytest.approx([75.0], abs=1.0)
    assert find_ground(POSE.scene(cloud[:20]), CAMERAS) is None


def test_ratios_use_long_distances():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    measured = np.column_stack([square / 4, np.zeros(4)])
    assert distance_ratios(measured, square) == pytest.approx(np.full(6, 4.0))
    row = np.array([[0, 0], [1, 0], [10, 0.0]])
    assert len(distance_ratios(np.column_stack([row, np.zeros(3)]), row)) == 2


def test_picks_are_read_and_doubtful_ones_refused(tmp_path):
    path = tmp_path / "scale_points.csv"
    path.write_text("point,image,x_px,y_px\na,000000.jpg,10,20.5\nb,000000.jpg,3,4\n")
    picks = read_picks(path)
    assert picks["a"]["000000.jpg"].tolist() == [10.5, 21.0]
    assert list(picks) == ["a", "b"]
    for text, word in (
        ("point,image,x_px\na,0.jpg,1\n", "y_px"),
        ("point,image,x_px,y_px\na,0.jpg,1,two\n", "row 2, column y_px: 'two'"),
        ("point,image,x_px,y_px\na,0.jpg,1,2\na,0.jpg,1,2\n", "row 3"),
        ("point,image,x_px,y_px\na,0.jpg,nan,2\n", "no x_px|nowhere"),
    ):
        path.write_text(text)
        with pytest.raises(BadInput, match=word):
            read_picks(path)
