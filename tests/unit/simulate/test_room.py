# SPDX-License-Identifier: Apache-2.0
"""The room of a simulated plant: table, lamps, things, markers and the card."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scenes.simulated_plant import SMALL, TINY, small_plant

from cotton3dg.commands import simulate as command
from cotton3dg.core.card import marker_corner_cm
from cotton3dg.core.scene import Camera
from cotton3dg.identity.codes import identify_plant, read_codes
from cotton3dg.options import SimulateOptions
from cotton3dg.scale.card import CARD_MARKERS, read_patches
from cotton3dg.scale.markers import find_markers
from cotton3dg.simulate.render import develop, light_scene, render
from cotton3dg.simulate.room import build_room
from cotton3dg.simulate.truth import plant_truth


def test_other_lamps_hang_in_the_same_room():
    plant = small_plant()
    rooms = [build_room(replace(SMALL, light=light), plant.stem_base) for light in (0, 1, 2)]
    corners = [np.stack([lamp.corner for lamp in room.lamps]) for room in rooms]
    assert all(np.abs(one - other).max() > 0.05 for one, other in itertools.pairwise(corners))
    for room in rooms[1:]:
        for panel, first in zip(room.panels, rooms[0].panels, strict=True):
            np.testing.assert_array_equal(panel.corner, first.corner)
            np.testing.assert_array_equal(panel.image, first.image)


def test_a_card_lies_on_the_table_as_printed():
    """Seen from 60 cm above: its id is read, and its corners lie on the table as far apart as they are printed."""
    options = replace(SMALL, card="NC26-017")
    plant = small_plant()
    room = build_room(options, plant.stem_base, command._printed_card(options.card))
    height, f, width = 0.6, 1100.0, 900
    rotation = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    centre = np.array([0.005 * options.table_length_cm - 0.16, 0.0, height])
    camera = Camera("above", width, width, f, f, width / 2, width / 2, np.column_stack([rotation, -rotation @ centre]))
    photo = develop(render(light_scene(plant, room), camera, supersampling=1))
    assert identify_plant(dict.fromkeys(read_codes(photo[..., 1]), 2)).plant_id == "NC26-017"
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


def test_the_table_has_the_size_asked_for_or_is_absent():
    stem_base = np.zeros(3)

    def top(options):
        """Length and width of the largest level panel at the height of the table top."""
        panels = build_room(options, stem_base).panels
        level = [p for p in panels if abs(p.corner[2]) < 1e-9 and p.across[2] == p.down[2] == 0]
        return max(((np.linalg.norm(p.across), np.linalg.norm(p.down)) for p in level), default=None)

    assert top(SMALL) == pytest.approx((1.2, 0.6))
    assert top(replace(SMALL, table_length_cm=90, table_width_cm=45)) == pytest.approx((0.9, 0.45))
    assert top(replace(SMALL, table=False)) is None
    assert plant_truth(small_plant(), replace(SMALL, table=False))["table"] is None


def test_markers_a_box_and_a_second_table_leave_the_room_as_it_is():
    plain = build_room(SimulateOptions(seed=4, width=160), np.zeros(3))
    more = build_room(SimulateOptions(seed=4, width=160, markers=3, hidden=0.25, second_table=True), np.zeros(3))
    assert len(more.panels) == len(plain.panels) + 3 + 5 + 5
    for before, after in zip(plain.panels, more.panels, strict=False):
        assert (before.corner == after.corner).all()
        assert (before.image == after.image).all()
    paper = more.panels[len(plain.panels)]
    assert np.linalg.norm(paper.across) == pytest.approx(0.12 * 8 / 6)
    assert paper.across @ paper.down == pytest.approx(0, abs=1e-12)


def test_things_stand_on_the_table_clear_of_the_plant_and_of_each_other() -> None:
    plant = small_plant()
    options = replace(TINY, things=8)
    room = build_room(options, plant.stem_base)
    plain = build_room(TINY, plant.stem_base)
    assert plain.things == ()
    assert [panel.corner.tolist() for panel in room.panels] == [panel.corner.tolist() for panel in plain.panels]
    assert 4 <= len(room.things) <= 8
    boxes = [(mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)) for mesh in room.things]
    for number, (low, high) in enumerate(boxes):
        assert 0 <= low[2] < 0.002
        assert (low[:2] > (-0.6, -0.3)).all()
        assert (high[:2] < (0.6, 0.3)).all()
        assert ((low > plant.stem_base)[:2] | (high < plant.stem_base)[:2]).any()
        for other_low, other_high in boxes[:number]:
            assert (low[:2] > other_high[:2]).any() or (high[:2] < other_low[:2]).any()
    assert build_room(replace(TINY, things=8, table=False), plant.stem_base).things == ()
