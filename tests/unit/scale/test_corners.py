# SPDX-License-Identifier: Apache-2.0
"""The scale after corners of the table were moved by hand."""

import numpy as np
import pytest
from scenes.table_scene import LENGTH_CM, POSE, WIDTH_CM, orbit

from cotton3dg.core.runs import StageOutcome
from cotton3dg.core.scene import Camera
from cotton3dg.options import ScaleOptions
from cotton3dg.scale.corners import fit_table_to_corners, move_corners
from cotton3dg.scale.estimate_scale import FoundScale, Plant, facts_of
from cotton3dg.scale.rectangle import Rectangle
from cotton3dg.scale.references import Reference, scale_on
from cotton3dg.schemas.scale import ScaleInfo

CAMERAS: dict[str, Camera] = {camera.name: camera for camera in orbit(12, 1280, 720)}
CORNERS = POSE.scene(np.array([[-60.0, -30, 0], [60, -30, 0], [60, 30, 0], [-60, 30, 0]]))


def found(moved_cm=(0.0, 0.0, 0.0, 0.0)):
    """A scale whose table has its sides (x of two, y of two) moved, with what it says the size is."""
    sides = (np.array([-60.0, 60, -30, 30]) + moved_cm) / POSE.cm_per_su
    ground = Rectangle(POSE.rotation.T, POSE.scene(np.zeros((1, 3)))[0], sides)
    return scale_on(ground, LENGTH_CM / ground.length, 0.002, "table")


def picked(place, *views, off_px=(0.0, 0.0)):
    """How two photos show a place, as picks."""
    names = [list(CAMERAS)[view] for view in views or (1, 4)]
    return {name: CAMERAS[name].project(place[None])[0][0] + off_px for name in names}


def moves_of(*corners, off_px=(0.3, -0.2)):
    return [picked(CORNERS[corner], off_px=off_px) for corner in corners]


def test_two_corners_of_a_wrong_edge_give_the_true_scale():
    wrong = found((0.0, 9.0, 0.0, 0.0))
    assert wrong.cm_per_su == pytest.approx(POSE.cm_per_su * 120 / 129)
    moved = fit_table_to_corners(wrong, CAMERAS, moves_of(1, 2), LENGTH_CM, WIDTH_CM)
    assert moved.refused == () and moved.reference.source == "corners"
    assert moved.reference.cm_per_su == pytest.approx(POSE.cm_per_su, rel=4 * moved.reference.relative_error)
    assert moved.reference.relative_error < 0.01
    assert moved.reference.evidence == {"moved_corners": [2, 3]}
    assert moved.rectangle.corners == pytest.approx(CORNERS, abs=1.0 / POSE.cm_per_su)


def test_a_moved_corner_takes_its_edges_with_it():
    wrong = found((0.0, 9.0, 0.0, 6.0))
    for corners in ((2,), (0, 2), (1, 3), (1, 2, 3), (0, 1, 2, 3)):
        moved = fit_table_to_corners(wrong, CAMERAS, moves_of(*corners, off_px=(0, 0)), LENGTH_CM, WIDTH_CM)
        assert moved.reference.cm_per_su == pytest.approx(POSE.cm_per_su, rel=1e-3), corners
        assert moved.rectangle.corners == pytest.approx(CORNERS, abs=0.1 / POSE.cm_per_su)
        assert moved.reference.relative_error == pytest.approx(0.001, abs=5e-4)


def test_an_edge_that_does_not_fit_the_size_makes_the_scale_less_sure():
    """2 cm too long: the scale is that of least squares over both sides."""
    out = found().table_frame[0] * 2 / POSE.cm_per_su
    moves = [picked(CORNERS[corner] + out) for corner in (1, 2)]
    moved = fit_table_to_corners(found(), CAMERAS, moves, LENGTH_CM, WIDTH_CM)
    sides = np.array([122.0, 60.0]), np.array([120.0, 60.0])
    assert moved.reference.cm_per_su == pytest.approx(
        POSE.cm_per_su * (120**2 + 60**2) / (sides[0] @ sides[1]), rel=1e-3
    )
    assert 0.003 < moved.reference.relative_error < 0.02


def test_the_last_move_of_a_corner_counts():
    moves = [picked(CORNERS[2] + found().table_frame[0] * 5 / POSE.cm_per_su), picked(CORNERS[2])]
    moved = fit_table_to_corners(found(), CAMERAS, moves, LENGTH_CM, WIDTH_CM)
    assert moved.reference.cm_per_su == pytest.approx(POSE.cm_per_su, rel=1e-3)


def test_what_is_no_corner_is_refused():
    def told(moves, length_cm=LENGTH_CM):
        moved = fit_table_to_corners(found(), CAMERAS, moves, length_cm, WIDTH_CM)
        assert moved.reference is None and moved.rectangle is None
        return " ".join(moved.refused)

    assert "+20.0 cm above the table top" in told([picked(POSE.scene(np.array([60.0, 30, 20])))])
    apart = picked(CORNERS[2])
    apart[next(iter(apart))] += [0, 80]
    assert "do not meet in space" in told([apart])
    assert "not those of a table of 200 x 60 cm" in told(moves_of(0, 1, 2, 3), length_cm=200.0)


def whole(references, scale):
    plant = Plant(
        list(CAMERAS.values()), lambda name: np.zeros((720, 1280, 3), np.uint8), np.zeros((0, 3)), np.zeros((0, 3))
    )
    info = ScaleInfo.of_scale(scale, references=facts_of(references)) if scale else ScaleInfo("none", "no table")
    return FoundScale(info, StageOutcome({}, ("table_edge_unclear",)), {}), plant


def test_markers_stay_beside_the_corners():
    wrong = found((0.0, 9.0, 0.0, 0.0))
    references = [Reference("table", wrong.cm_per_su, 0.002), Reference("aruco", POSE.cm_per_su * 1.001, 0.003)]
    before, plant = whole(references, wrong)
    after = move_corners(before, plant, moves_of(1, 2), ScaleOptions())
    assert set(after.info.source.split("+")) == {"corners", "aruco"}
    assert after.info.cm_per_su == pytest.approx(POSE.cm_per_su, rel=3e-3)
    assert after.info.found == before.info and after.info.moved_corners == 2
    assert after.outcome.flags == ()
    assert sorted(after.pictures) == ["corners_0.jpg", "corners_1.jpg"]


@pytest.mark.parametrize(
    ("references", "scale"), [([Reference("aruco", 37.0, 0.003)], found()), ([], None)], ids=["markers", "none"]
)
def test_a_scale_without_a_table_is_left_alone(references, scale):
    before, plant = whole(references, scale)
    after = move_corners(before, plant, moves_of(1), ScaleOptions(), ["a photo is another one"])
    assert after.info == before.info
    assert after.outcome.flags == ("table_edge_unclear", "corrections_not_applied")
    assert after.outcome.warnings == (
        "correction not applied: corner: a photo is another one",
        "correction not applied: corner: the scale does not come from the table",
    )
