# SPDX-License-Identifier: Apache-2.0
"""Ids on cards: which text is one, what folder it names, and what hostile ones do."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cotton3dg.identity.names import MOST_CHARACTERS, card_id, card_text, folder_name, id_problem

HOSTILE = ("../../etc/passwd", "/abs/olute", "..", ".", "-rf", "=cmd|' /C calc'!A1", "CON", "nul.txt", "a\\b", "a/b",
           "C:\\x", "~root", "$(reboot)", "`x`", "a" * 64, "ä/ö", "名前/1", "a b", ".x",
           "x.", "<b>&\"'")  # fmt: skip


@pytest.mark.parametrize("plant_id", HOSTILE)
def test_a_hostile_id_becomes_a_safe_name(plant_id, tmp_path):
    assert card_id(card_text(plant_id)) == plant_id
    name = folder_name(plant_id)
    folder = tmp_path / name
    folder.mkdir()
    assert folder.resolve().parent == tmp_path.resolve()
    assert not name.startswith((".", "-")) and not name.endswith(".") and name.lower() not in ("con", "nul.txt")


def test_names_of_ordinary_ids_are_the_ids():
    for plant_id in ("plant_017", "2026-NC-0417", "Größe.3", "A+B", "名前1"):
        assert folder_name(plant_id) == plant_id
    assert len({folder_name(plant_id) for plant_id in HOSTILE}) == len(HOSTILE)


@given(st.text(max_size=80))
@settings(max_examples=300, deadline=None)
def test_any_text_is_an_id_that_comes_back_or_is_refused(text):
    if id_problem(text):
        assert card_id(card_text(text)) is None
    else:
        assert card_id(card_text(text)) == text
        assert 0 < len(folder_name(text)) < 100


@pytest.mark.parametrize("text", ["", " ", "a\nb", "a\0", "x" * (MOST_CHARACTERS + 1), "x" * 10_000, "a\u202eb", " a"])
def test_what_cannot_be_an_id_is_refused(text):
    assert id_problem(text)
    assert card_id(card_text(text)) is None


def test_a_code_misread_is_noticed():
    text = card_text("plant_017")
    for changed in (text.replace("017", "011"), text[:-1], text + "A", text.removeprefix("c3d:"), "c3d:", "c3d::", ""):
        assert card_id(changed) is None
