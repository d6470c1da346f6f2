"""What simulate changes between two films of one plant, and the card that it lays on the table."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from cotton3dg.commands import simulate as command
from cotton3dg.core.card import marker_corner_cm
from cotton3dg.core.scene import Camera
from cotton3dg.errors import BadUsage
from cotton3dg.identity.codes import read_codes, whose
from cotton3dg.options import SimulateOptions
from cotton3dg.scale.card import CARD_MARKERS
from cotton3dg.scale.grey_card import read_patches
from cotton3dg.scale.markers import find_markers
from cotton3dg.simulate.camera import orbit
from cotton3dg.simulate.camera_effects import exposure_ev
from cotton3dg.simulate.plant import grow_plant
from cotton3dg.simulate.render import develop, light_scene, render
from cotton3dg.simulate.room import build_room
from cotton3dg.simulate.truth import plant_truth

SMALL = SimulateOptions(seed=3, bolls=6, frames=16, width=192, height=108)


@pytest.mark.parametrize("architecture", ["simple", "natural"])
def test_picked_bolls_are_gone_and_all_else_is_the_same(architecture):
    options = replace(SMALL, architecture=architecture)
    before, after = grow_plant(options), grow_plant(replace(options, picked=2))
    assert len(after.bolls) == len(before.bolls) - 2
    np.testing.assert_array_equal(after.wood.vertices, before.wood.vertices)
    np.testing.assert_array_equal(after.bolls[-1].lint.vertices, before.bolls[-3].lint.vertices)
    truths = [plant_truth(plant, options) for plant in (before, after)]
    assert truths[1]["boll_count"] == truths[0]["boll_count"] - 2
    assert [axis["boll_id"] for axis in truths[1]["skeleton"] if axis["boll_id"]] == list(
        range(1, len(after.bolls) + 1)
    )
    assert len(grow_plant(replace(options, picked=60)).bolls) == 0


def test_a_turned_plant_is_the_same_plant_turned_about_its_foot():
    before, after = grow_plant(SMALL), grow_plant(replace(SMALL, turned_deg=90.0))
    foot = before.stem_base
    np.testing.assert_array_equal(after.stem_base, foot)
    for one, other in zip(before.parts, after.parts, strict=True):
        x, y, z = (one.vertices - foot).T
        np.testing.assert_allclose(other.vertices, foot + np.stack([-y, x, z], axis=1), atol=1e-12)
    truths = [plant_truth(plant, SMALL) for plant in (before, after)]
    assert truths[0]["total_boll_convex_volume_cm3"] == truths[1]["total_boll_convex_volume_cm3"]


def test_another_walk_is_around_the_same_plant():
    plant = grow_plant(SMALL)
    paths = [orbit(replace(SMALL, walk=walk), plant.vertices) for walk in (0, 1, 2)]
    assert len({path.start for path in paths}) == 3
    np.testing.assert_array_equal(grow_plant(replace(SMALL, walk=1)).wood.vertices, plant.wood.vertices)


def test_other_lamps_hang_in_the_same_room():
    plant = grow_plant(SMALL)
    rooms = [build_room(replace(SMALL, light=light), plant.stem_base) for light in (0, 1, 2)]
    corners = [np.stack([lamp.corner for lamp in room.lamps]) for room in rooms]
    assert all(np.abs(one - other).max() > 0.05 for one, other in itertools.pairwise(corners))
    for room in rooms[1:]:
        for panel, first in zip(room.panels, rooms[0].panels, strict=True):
            np.testing.assert_array_equal(panel.corner, first.corner)
            np.testing.assert_array_equal(panel.image, first.image)


def test_the_camera_goes_farther_away():
    vertices = grow_plant(SMALL).vertices
    near, far = (orbit(replace(SMALL, farther=farther), vertices) for farther in (0.0, 0.25))
    assert far.radius == pytest.approx(1.25 * near.radius)
    assert far.height == near.height


def test_a_dark_film_is_that_many_stops_darker():
    dark = replace(SMALL, dark=2.0, exposure=0.5)
    for frame in range(SMALL.frames):
        assert exposure_ev(frame, dark) == pytest.approx(exposure_ev(frame, replace(dark, dark=0.0)) - 2)
    assert exposure_ev(0, replace(SMALL, dark=1.5)) == -1.5


def test_a_card_lies_on_the_table_as_printed():
    """Seen from 60 cm above: its id is read, and its corners lie on the table as far apart as they are printed."""
    options = replace(SMALL, card="NC26-017")
    plant = grow_plant(options)
    room = build_room(options, plant.stem_base, command._printed_card(options.card))
    height, f, width = 0.6, 1100.0, 900
    rotation = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    centre = np.array([0.005 * options.table_length_cm - 0.16, 0.0, height])
    camera = Camera("above", width, width, f, f, width / 2, width / 2, np.column_stack([rotation, -rotation @ centre]))
    photo = develop(render(light_scene(plant, room), camera, supersampling=1))
    assert whose(dict.fromkeys(read_codes(photo[..., 1]), 2)).plant_id == "NC26-017"
    corners = find_markers(photo, CARD_MARKERS)
    assert len(corners) == 16
    cm_per_px = 100 * (height - 0.0016) / f
    seen = np.array(list(corners.values())) * cm_per_px
    printed = np.array([marker_corner_cm(marker, corner) for _, marker, corner in corners])
    for a in range(len(seen)):
        apart = np.linalg.norm(seen - seen[a], axis=1)
        np.testing.assert_allclose(apart, np.linalg.norm(printed - printed[a], axis=1), atol=0.06)
    levels = read_patches(photo, corners)
    assert (np.diff(levels[np.isfinite(levels).all(axis=1)], axis=0) < 0).all()


def test_a_card_needs_an_id(tmp_path):
    with pytest.raises(BadUsage, match="no id"):
        command.simulate(tmp_path / "new", replace(SMALL, card=" "))
