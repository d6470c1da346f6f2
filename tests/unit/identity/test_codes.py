# SPDX-License-Identifier: Apache-2.0
"""Codes on cards: how they are read, and what a video's codes say together."""

import cv2
import numpy as np
from scenes.card_scene import card_photo, card_sheet

from cotton3dg.identity.codes import Identity, code_picture, identify_plant, read_codes
from cotton3dg.identity.names import card_id, card_text


def test_votes():
    a, b = card_text("A"), card_text("B")
    assert identify_plant({a: 3}) == Identity("A", "", {"A": 3})
    assert identify_plant({}).doubt == "no card was read"
    assert "one frame" in identify_plant({a: 1}).doubt
    assert "A in 30 frames, B in 1" in identify_plant({b: 1, a: 30}).doubt
    assert "not in the field book" in identify_plant({a: 9}, {"B"}).doubt
    # A label of the lab's own counts when the field book knows it; the net's address on a box never does.
    assert identify_plant({"A": 3}).doubt == "no card was read"
    assert identify_plant({"A": 3, "https://example.org": 9}, {"A", "B"}).plant_id == "A"
    assert identify_plant({"A": 3, a: 4}, {"A"}) == Identity("A", "", {"A": 4})


def test_a_card_is_read_from_above_and_aslant():
    sheet = card_sheet("2026-NC-0417", 20)
    assert [card_id(text) for text in read_codes(sheet)] == ["2026-NC-0417"]
    for tilt, turn in ((0, 30), (45, 100), (60, 200)):
        photo = card_photo(sheet, 130, tilt_deg=tilt, turn_deg=turn, blur_px=0.6, noise=3, light=(0.4, 1.2))
        assert [card_id(text) for text in read_codes(photo)] == ["2026-NC-0417"], tilt


def test_a_code_with_dirt_on_a_corner_is_read_by_the_markers():
    sheet = card_sheet("2026-NC-0417", 20)
    photo = card_photo(sheet, 160, tilt_deg=30, turn_deg=20, blur_px=0.5, noise=2)
    found, corners = cv2.QRCodeDetector().detect(photo)
    assert found
    corner, middle = corners[0][0], corners[0].mean(axis=0)
    place = corner + 0.12 * (middle - corner)
    soiled = cv2.circle(photo, tuple(int(x) for x in place), 15, 90, -1)
    assert [card_id(text) for text in read_codes(soiled)] == ["2026-NC-0417"]


def test_nothing_is_read_where_there_is_none():
    assert read_codes(np.full((200, 300), 90, np.uint8)) == []
    assert read_codes(np.random.default_rng(0).integers(0, 255, (300, 400)).astype(np.uint8)) == []
    assert code_picture("x").shape == (21, 21)
