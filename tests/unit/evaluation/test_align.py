# SPDX-License-Identifier: Apache-2.0
"""Two films of a plant in one frame: known turns, leans and shifts; plants that cannot be aligned."""

import numpy as np
import pytest
from scenes.filmed_scene import NO_MAP, filmed_again, grown, leaning

from cotton3dg.evaluation.align import Alignment, Layout, NoAlignment, about_vertical, align
from cotton3dg.evaluation.align_bolls import align_by_bolls


def turn_error(found: Alignment, turn_deg: float) -> float:
    """Degrees."""
    return abs((found.turn_deg - turn_deg + 180) % 360 - 180)


def test_a_quarter_turn_is_taken_back_to_the_digit():
    """Bolls of a to b by (x, y) -> (-y, x), counter-clockwise: the alignment is its inverse, by hand."""
    a = Layout(np.array([[10.0, 0, 20], [0, 12, 30], [-7, -7, 40], [3, -11, 50], [8, 6, 33]]), (0,) * 5, NO_MAP)
    b = Layout(np.array([[0.0, 10, 20], [-12, 0, 30], [7, -7, 40], [11, 3, 50], [-6, 8, 33]]), (0,) * 5, NO_MAP)
    found = align(a, b, 3.0)
    assert found.turn_deg == pytest.approx(90)
    assert found.lean_deg == pytest.approx(0, abs=1e-4)
    np.testing.assert_allclose(found.apply(b.centres_cm), a.centres_cm, atol=1e-9)
    assert found.support == pytest.approx(5)
    assert found.n_items == 5


@pytest.mark.parametrize("turn_deg", [-170.0, -31.0, 0.0, 77.7, 180.0])
@pytest.mark.parametrize("branches", [True, False])
def test_turn_shift_and_missing_bolls(turn_deg, branches):
    a = grown(10, seed=3, branches=branches)
    kept = [0, 2, 3, 5, 6, 9]
    b = filmed_again(a, leaning(turn_deg), (0.6, -0.5, 0.2), kept, noise_cm=0.3, seed=1)
    found = align(a, b, 3.0)
    assert turn_error(found, turn_deg) < 2.5
    assert np.median(np.linalg.norm(found.apply(b.centres_cm) - a.centres_cm[kept], axis=1)) < 0.8
    assert found.chance <= 0.01


def test_a_plant_that_leans_otherwise_is_set_upright_by_its_stem():
    a = grown(12, seed=5)
    b = filmed_again(a, leaning(140, 5.0, 60), (1.0, 0.4, 0.0), noise_cm=0.2)
    found = align(a, b, 3.0)
    assert turn_error(found, 140) < 1.5
    assert found.lean_deg == pytest.approx(5.0, abs=0.7)
    assert np.linalg.norm(found.apply(b.centres_cm) - a.centres_cm, axis=1).max() < 1.2


def test_order_of_the_films_makes_no_difference():
    a = grown(9, seed=8)
    b = filmed_again(a, leaning(50), kept=[1, 4, 6, 8], noise_cm=0.2)
    there, back = align(a, b, 3.0), align(b, a, 3.0)
    assert there.turn_deg == pytest.approx(-back.turn_deg, abs=1.0)
    np.testing.assert_allclose(there.rotation @ back.rotation, np.eye(3), atol=0.03)


def test_a_plant_picked_bare_is_aligned_by_its_branches():
    a = grown(8, seed=2)
    b = filmed_again(a, leaning(-100), kept=[3], noise_cm=0.2)
    assert turn_error(align(a, b, 3.0), -100) < 4


def test_bolls_on_the_line_of_the_stem_do_not_spoil_the_turn():
    """All that is left is the boll on the tip; its branch is the stem."""
    a = grown(8, seed=2)
    tip = a.plant_map.stem.curve[-1] + (0, 0, 2)
    a = Layout(np.vstack([a.centres_cm, tip]), (*a.branch_of, 0), a.plant_map)
    b = filmed_again(a, leaning(-100), kept=[8], noise_cm=0.3)
    assert turn_error(align(a, b, 3.0), -100) < 4
    bare = filmed_again(a, leaning(-100), kept=[])
    assert turn_error(align(a, bare, 3.0), -100) < 4


def ring(n, heights=30.0, odd=()):
    """n bolls evenly around the stem at one height."""
    angles = 2 * np.pi * np.arange(n) / n
    centres = np.column_stack([12 * np.cos(angles), 12 * np.sin(angles), np.full(n, heights)])
    return Layout(np.vstack([centres, *odd]), (0,) * (n + len(odd)), NO_MAP)


def test_a_symmetrical_plant_is_refused_and_an_odd_boll_decides():
    b = filmed_again(ring(5), leaning(20))
    found = align(ring(5), b, 3.0)
    assert isinstance(found, NoAlignment)
    a = ring(5, odd=[[0.0, 15.0, 45.0]])
    found = align(a, filmed_again(a, leaning(20)), 3.0)
    assert isinstance(found, Alignment)
    assert turn_error(found, 20) < 0.1


def test_a_symmetrical_plant_is_aligned_by_a_turn_that_is_known():
    b = filmed_again(ring(5), leaning(20))
    for told, turn in ((20.0, 20.0), (27.0, 20.0), (-52.0, -52.0), (-160.0, 20.0)):
        found = align(ring(5), b, 3.0, turn_deg=told)
        assert found.turn_deg == pytest.approx(turn, abs=0.2)
        assert np.isnan(found.chance)
    lone = Layout(np.array([[12.0, 0, 70.0]]), (0,), NO_MAP)
    assert "no boll and no branch" in align(ring(5), lone, 3.0, turn_deg=0.0).reason


def test_two_bolls_say_nothing_of_the_turn():
    a = Layout(np.array([[10.0, 0, 20], [0, 12, 30]]), (0, 0), NO_MAP)
    found = align(a, filmed_again(a, leaning(40)), 3.0)
    assert isinstance(found, NoAlignment)
    assert "too few" in found.reason


def test_bolls_that_could_be_anybodys_are_chance():
    a = ring(3, heights=30.0)
    b = Layout(np.array([[0, 12.0, 30], [11, 4, 33], [-9, 8.0, 28]]), (0,) * 3, NO_MAP)
    found = align(a, b, 3.0)
    assert isinstance(found, NoAlignment)
    assert "which chance does in" in found.reason


def test_plants_without_bolls_and_branches():
    empty = Layout(np.zeros((0, 3)), (), NO_MAP)
    for a, b in ((empty, empty), (grown(5), empty), (empty, grown(5))):
        assert "no bolls and branches" in align(a, b, 3.0).reason
    unplaced = Layout(np.full((4, 3), np.nan), (0,) * 4, NO_MAP)
    assert isinstance(align(grown(5, branches=False), unplaced, 3.0), NoAlignment)


@pytest.mark.parametrize("branches", [True, False])
def test_another_plant_is_refused(branches):
    """Of the same species: branches at the same heights, three eighths of a turn apart."""
    accepted = sum(
        isinstance(align(grown(10, seed, branches), grown(8, 100 + seed, branches), 3.0), Alignment)
        for seed in range(12)
    )
    assert accepted <= 1


def test_about_vertical_turns_x_towards_y():
    np.testing.assert_allclose(about_vertical(np.pi / 2) @ [1, 0, 5], [0, 1, 5], atol=1e-12)


@pytest.mark.parametrize("branches", [True, False])
def test_a_foot_that_was_guessed_is_found_from_the_bolls(branches):
    """Of the other film the stem is not known, and its foot is 13 cm beside the place."""
    a = grown(8, seed=6, branches=branches)
    b = filmed_again(a, leaning(70), (4.4, 12.6, 0.1), kept=[0, 1, 3, 4, 6, 7], noise_cm=0.3)
    b = Layout(b.centres_cm, (0,) * 6, NO_MAP)
    found = align(a, b, 3.0)
    assert turn_error(found, 70) < 3
    kept = a.centres_cm[[0, 1, 3, 4, 6, 7]]
    assert np.linalg.norm(found.apply(b.centres_cm) - kept, axis=1).max() < 1.2
    assert (found.n_items, found.lean_deg) == (6, 0.0)
    assert 5 < found.support <= 6
    assert found.chance <= 0.01


def test_bolls_alone_need_four_and_no_second_turn():
    a = np.array([[10.0, 0, 20], [0, 12, 30], [-7, -7, 40], [3, -11, 50], [8, 6, 60]])
    moved = a @ about_vertical(1.0).T + (9.0, -4.0, 0.0)
    found = align_by_bolls(a, moved)
    assert found.angle == pytest.approx(-1.0)
    np.testing.assert_allclose(found.shift_cm, -np.array([9.0, -4.0, 0.0]) @ about_vertical(-1.0).T, atol=1e-9)
    assert align_by_bolls(a[:3], moved) is None
    assert align_by_bolls(a, moved * (1, -1, 1)) is None  # a mirror image
    assert align_by_bolls(a, moved + (0, 0, 5)) is None  # another height above the table
    assert align_by_bolls(np.full((5, 3), np.nan), moved) is None
    angles = np.pi / 3 * np.arange(6)
    regular = np.column_stack([12 * np.cos(angles), 12 * np.sin(angles), np.full(6, 30.0)])
    assert align_by_bolls(regular, regular) is None
