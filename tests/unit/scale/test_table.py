# SPDX-License-Identifier: Apache-2.0
"""The table in a made room: from points alone and with photos."""

import numpy as np
import pytest
from scenes.table_scene import POSE, SECOND_CM, orbit, photo, table_points_cm
from scipy.spatial.transform import Rotation

from cotton3dg.geometry.camera_orbit import fit_orbit
from cotton3dg.geometry.planes import level_planes
from cotton3dg.scale.rectangle import Rectangle, RimFit, fit_rim, smoothed
from cotton3dg.scale.table import (
    NoTable,
    TableFit,
    _doubt,
    find_table,
    outline_table,
    outlines_table,
    scale_from_table,
)

CAMERAS = orbit(20, 320, 180)


@pytest.fixture(scope="module")
def images():
    return [photo(camera) for camera in CAMERAS]


def points():
    return POSE.scene(table_points_cm(np.random.default_rng(0)))


def rectangle_cm(sides, turn_deg=0.0, lift_cm=0.0):
    turn = Rotation.from_euler("z", turn_deg, degrees=True).as_matrix()
    return Rectangle(
        turn.T @ POSE.rotation.T, POSE.scene(np.array([[0, 0, lift_cm]]))[0], np.array(sides, float) / POSE.cm_per_su
    )


def test_points_alone_give_the_scale_to_two_percent():
    fit = find_table(points(), CAMERAS)
    assert isinstance(fit, TableFit)
    scale = scale_from_table(fit, 120, 60)
    assert scale.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.02)
    assert scale.up @ POSE.rotation[:, 2] > np.cos(np.radians(0.3))
    assert fit.rim is None


def test_photos_give_the_scale_to_three_parts_in_a_thousand(images):
    fit = find_table(points(), CAMERAS, images, CAMERAS)
    scale = scale_from_table(fit, 120, 60)
    assert scale.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.003)
    assert scale.relative_error < 0.01
    corners = POSE.cm(scale.corners)
    assert np.abs(corners) == pytest.approx(np.tile([60, 30, 0], (4, 1)), abs=0.3)
    # The first camera stands at +x; z of the frame points up.
    assert scale.table_frame @ POSE.rotation == pytest.approx(np.eye(3), abs=0.01)
    assert scale.height_cm(POSE.scene(np.array([[10, 5, 33.0]]))) == pytest.approx([33.0], abs=0.2)


def test_the_rim_is_found_from_a_poor_start(images):
    fit = fit_rim(rectangle_cm([-57, 63, -32, 29], turn_deg=1.5, lift_cm=0.2), CAMERAS, smoothed(images))
    found = POSE.cm(fit.rectangle.corners)
    assert found == pytest.approx(np.array([[-60, -30, 0], [60, -30, 0], [60, 30, 0], [-60, 30, 0]]), abs=0.4)
    assert max(fit.residual_px) < 0.5
    assert min(fit.support) > 0.5


def test_a_rim_that_no_photo_shows_is_none(images):
    turned_away = [camera for camera in CAMERAS if POSE.cm(camera.centre[None])[0][0] > 65]
    seen = [image for camera, image in zip(CAMERAS, images, strict=True) if camera in turned_away]
    assert fit_rim(rectangle_cm([-60, 60, -30, 30]), turned_away, smoothed(seen)) is None


def test_the_floor_and_the_clamp_are_no_table():
    planes = level_planes(points(), fit_orbit(CAMERAS))
    heights = [plane[:3] @ POSE.scene(np.zeros((1, 3)))[0] + plane[3] for plane in planes]
    assert abs(heights[0] * POSE.cm_per_su) < 0.2
    assert all(plane[:3] @ POSE.rotation[:, 2] > 0.99 for plane in planes)


def test_a_table_of_another_shape_is_refused(images):
    square = find_table(points(), CAMERAS, images, CAMERAS, aspect=1.0)
    assert isinstance(square, NoTable)
    assert "2.00 to 1" in square.reason


def test_no_table_is_said():
    air = POSE.scene(np.random.default_rng(0).uniform([-90, -90, -60], [90, 90, 90], (3000, 3)))
    assert isinstance(find_table(air, CAMERAS), NoTable)


def test_an_outline_of_the_known_shape_is_told_from_others_without_photos():
    around = fit_orbit(CAMERAS)
    assert outlines_table(points(), around, aspect=2.0)
    assert not outlines_table(points(), around, aspect=1.5)
    cm = table_points_cm(np.random.default_rng(0))
    covered_in_part = cm[(cm[:, 0] < 10) | (np.abs(cm[:, 2]) > 1)]
    assert not outlines_table(POSE.scene(covered_in_part), around, aspect=2.0)
    assert not outlines_table(np.zeros((0, 3)), around, aspect=2.0)


def test_same_seed_same_table():
    first, second = (find_table(points(), CAMERAS, seed=3) for _ in range(2))
    assert first.rectangle.corners.tobytes() == second.rectangle.corners.tobytes()


def test_the_outline_is_drawn_on_the_rim(images):
    drawn = outline_table(images[0], CAMERAS[0], rectangle_cm([-60, 60, -30, 30]))
    changed = np.argwhere((drawn != images[0]).any(-1))
    assert len(changed) > 200
    # Magenta: less green than before wherever the line was drawn, and next to the corners of the table.
    assert (drawn[tuple(changed.T)][:, 1] <= images[0][tuple(changed.T)][:, 1]).all()
    corners, _ = CAMERAS[0].project(POSE.scene(np.array([[-60, -30, 0], [-60, 30, 0.0]])))
    for corner in corners:
        assert np.linalg.norm(changed[:, ::-1] + 0.5 - corner, axis=1).min() < 2


def test_a_far_start_settles_where_a_near_one_does(images):
    """The rim is followed until it rests, not for a number of rounds."""
    near = fit_rim(rectangle_cm([-60, 60, -30, 30]), CAMERAS, smoothed(images)).rectangle
    far = fit_rim(rectangle_cm([-62, 63, -32, 31.5], turn_deg=1.0, lift_cm=-0.4), CAMERAS, smoothed(images)).rectangle
    assert far.length == pytest.approx(near.length, rel=0.001)
    assert far.width == pytest.approx(near.width, rel=0.001)


@pytest.mark.slow
def test_a_half_hidden_table_is_measured_rightly_or_refused():
    """A box stands on one end: the points end there and so does what the photos show of the long sides."""
    cameras = orbit(14, 320, 180)
    for box_from_cm in (0.0, 45.0):
        seen = [photo(camera, box_from_cm=box_from_cm) for camera in cameras]
        cloud = table_points_cm(np.random.default_rng(0))
        hidden = (cloud[:, 0] > box_from_cm) & (np.abs(cloud[:, 2]) < 1.0) & (np.abs(cloud[:, 1]) < 36)
        fit = find_table(POSE.scene(cloud[~hidden]), cameras, seen, cameras)
        if isinstance(fit, TableFit):
            assert scale_from_table(fit, 120, 60).cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.01)
        else:
            assert fit.reason


@pytest.mark.parametrize(("unclear", "sides_cm"), [(3, (120, 57.8)), (2, (120, 58.0)), (0, (124, 60)), (1, (117, 60))])
def test_a_side_that_ends_in_an_unclear_edge_gives_no_scale(unclear, sides_cm):
    length, width = sides_cm
    support = tuple(0.3 if edge == unclear else 0.7 for edge in range(4))
    rim = RimFit(rectangle_cm([-60, length - 60, -30, width - 30]), (0.3,) * 4, support, (9,) * 4)
    fit = TableFit(rim.rectangle, 1.0, 500, rim)
    assert fit.unclear_edges == (unclear,)
    scale = scale_from_table(fit, 120, 60)
    assert scale.cm_per_su == pytest.approx(POSE.cm_per_su, rel=1e-6)
    assert scale.relative_error == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("support", "taken"),
    [
        ((0.7, 0.6, 0.5, 0.38), True),
        ((0.45, 0.6, 0.5, 0.38), False),  # the side that is left is not clear enough to stand alone
        ((0.7, 0.6, 0.38, 0.38), False),  # nor may two edges lack
        ((0.7, 0.6, 0.45, 0.41), True),
    ],
)
def test_one_unclear_edge_is_no_reason_to_refuse_a_table(support, taken):
    rim = RimFit(rectangle_cm([-60, 60, -30, 30]), (0.3,) * 4, support, (9,) * 4)
    doubt = _doubt(TableFit(rim.rectangle, 1.0, 500, rim), 2.0, most_unclear=1)
    assert (doubt == "") is taken
    assert not taken or min(support) > 0.4 or _doubt(TableFit(rim.rectangle, 1.0, 500, rim), 2.0, most_unclear=0)


def test_a_line_beside_an_edge_that_is_stronger_than_the_edge_does_not_cost_the_table():
    seen = [photo(camera, border_cm=4.0) for camera in CAMERAS]
    fit = find_table(points(), CAMERAS, seen, CAMERAS)
    assert isinstance(fit, TableFit), fit
    assert scale_from_table(fit, 120, 60).cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.005)


def test_a_second_table_beside_it_is_not_taken_for_it():
    seen = [photo(camera, second=True) for camera in CAMERAS]
    rng = np.random.default_rng(0)
    second = np.column_stack([rng.uniform(*SECOND_CM, (3000, 2)), rng.normal(0, 0.15, 3000)])
    fit = find_table(POSE.scene(np.vstack([table_points_cm(rng), second])), CAMERAS, seen, CAMERAS)
    assert isinstance(fit, TableFit)
    assert scale_from_table(fit, 120, 60).cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.005)
