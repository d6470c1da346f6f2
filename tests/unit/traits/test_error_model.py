# SPDX-License-Identifier: Apache-2.0
"""What traits may be off by, against hand-computed cases and draws."""

from dataclasses import replace

import numpy as np
import pytest
from scenes.table_scene import POSE

from cotton3dg.core.measurements import BollTraits, Scale
from cotton3dg.traits import error_model
from cotton3dg.traits.error_model import (
    Conditions,
    blurs_bolls,
    boll_volume_error,
    find_touching,
    find_unround,
    halves_disagree,
    interval,
    nearest_neighbours,
    parted_error,
    plant_volume_error_cm3,
    size_error_cm,
)


def scale(relative_error: float) -> Scale:
    corners = POSE.scene(np.array([[-60, -30, 0], [60, -30, 0], [60, 30, 0], [-60, 30, 0]], float))
    return Scale(2.0, relative_error, "table", np.array([0.0, 0, 1]), np.array([0.0, 0, 1, 0]), corners)


def boll(volume_cm3: float, error_cm3: float, diameter_cm: float = 4.0) -> BollTraits:
    return BollTraits(1, np.zeros(3), volume_cm3, volume_cm3, diameter_cm, 100, 20, 1.0, (), error_cm3)


@pytest.fixture(autouse=True)
def same_edge(monkeypatch) -> float:
    """All kinds of bolls have their edge where it is expected; returns the usual error of that."""
    usual = error_model.LINT_EDGE
    monkeypatch.setattr(error_model, "LINT_EDGE", 0.0)
    return usual


def test_where_lint_ends_makes_all_volumes_of_a_plant_less_sure(monkeypatch, same_edge) -> None:
    assert 0.01 < same_edge < 0.05
    sure = boll_volume_error(25.0, 8000.0, 32, scale(0.0), 1.0)
    monkeypatch.setattr(error_model, "LINT_EDGE", 0.1)
    assert boll_volume_error(25.0, 8000.0, 32, scale(0.0), 1.0) == pytest.approx(np.hypot(sure, 0.1))
    bolls = [boll(8.0, 0.8) for _ in range(400)]
    of_plant = plant_volume_error_cm3(bolls, np.full(400, np.inf), scale(0.0), 0.0)
    assert of_plant == pytest.approx(400 * 0.8, rel=0.01)


def test_bolls_touch_within_a_fifth_more_than_a_diameter() -> None:
    centres = np.array([[0, 0, 0], [4.5, 0, 0], [20, 0, 0], [24.9, 0, 0], [np.nan, 0, 0]])
    nearest = nearest_neighbours(centres, np.array([4.0, 5.0, 4.0, 4.0, 4.0]))
    assert nearest == pytest.approx([1.0, 1.0, 4.9 / 4, 4.9 / 4, np.inf])
    assert find_touching(nearest).tolist() == [True, True, False, False, False]
    assert nearest_neighbours(centres[:2], np.array([4.0, np.nan])).tolist() == [np.inf, np.inf]
    assert nearest_neighbours(np.zeros((1, 3)), np.ones(1)).tolist() == [np.inf]
    assert nearest_neighbours(np.zeros((0, 3)), np.zeros(0)).tolist() == []
    # Two in one place.
    assert nearest_neighbours(np.zeros((2, 3)), np.ones(2)).tolist() == [0.0, 0.0]


def test_the_deeper_a_boll_is_in_another_the_less_sure_is_where_it_ends() -> None:
    assert parted_error(np.array([np.inf, 1.3, 1.2, 1.0, 0.7])) == pytest.approx(
        error_model.PARTED * np.array([0, 0, 0, 0.04, 0.25])
    )


def test_a_touching_boll_less_round_than_the_others_is_perhaps_two() -> None:
    nearest = np.array([0.8, 0.8, 1.0, np.inf, np.inf, 0.9])
    roundness = np.array([0.80, 0.86, 0.90, 0.80, 0.91, np.nan])
    assert find_unround(nearest, roundness).tolist() == [True, False, False, False, False, False]
    assert find_unround(nearest[:1], np.array([np.nan])).tolist() == [False]
    assert find_unround(np.zeros(0), np.zeros(0)).tolist() == []


def test_lengths_err_with_the_scale_and_a_part_of_a_pixel() -> None:
    assert size_error_cm(80.0, scale(0.01), 0.0) == pytest.approx(0.8)
    assert size_error_cm(80.0, scale(0.01), 0.3) == pytest.approx(np.hypot(0.8, 0.3 * error_model.SIZE_PX))
    assert size_error_cm(80.0, scale(0.01), 0.0, [81.0, 82.0]) == pytest.approx(np.hypot(0.8, 2.0))
    blurred = np.hypot(0.3 * error_model.SIZE_PX, 0.3 * 12 * error_model.SMEARED_SIZE)
    assert size_error_cm(80.0, scale(0.0), 0.3, blur_px=12) == pytest.approx(blurred)
    assert np.isnan(size_error_cm(80.0, None, 0.3))


def test_a_boll_errs_with_scale_edges_shape_and_a_neighbour(monkeypatch) -> None:
    """A diameter of 25 px, seen by 32 views of which four count; a tenth of a pixel at either side, for all bolls. A
    tenth of a ball of that diameter is missing; a neighbour is 0.8 diameters away."""
    constants = {"SHAPE": 0.3, "EDGE_PX": 0.5, "SHARED_EDGE_PX": 0.1, "PARTED": 0.75}
    for name, value in constants.items():
        monkeypatch.setattr(error_model, name, value)
    volume = 0.9 * np.pi / 6 * 25**3
    parts = [0.03, 3 * 0.5 / 25 / 2, 3 * 0.2 / 25]
    assert boll_volume_error(25.0, volume, 32, scale(0.0), 1.0) == pytest.approx(np.linalg.norm(parts))
    assert boll_volume_error(25.0, volume, 32, scale(0.01), 1.0) == pytest.approx(np.linalg.norm([*parts, 0.03]))
    with_neighbour = boll_volume_error(25.0, volume, 32, scale(0.0), 1.0, nearest=0.8)
    assert with_neighbour == pytest.approx(np.linalg.norm([*parts, 0.12]))
    assert np.isnan(boll_volume_error(25.0, volume, 32, None, 1.0))
    # A ball has no error of its shape, nor what numbers make a hair larger.
    ball = boll_volume_error(25.0, 1.0001 * volume / 0.9, 32, scale(0.0), 1.0)
    assert ball == pytest.approx(np.linalg.norm(parts[1:]))
    # A blur of 10 px moves edges as far out as unsure masks do.
    monkeypatch.setattr(error_model, "SHARED_BLUR", 0.01)
    blurred = boll_volume_error(25.0, volume, 32, scale(0.0), 1.0, conditions=Conditions(blur_px=10.0))
    assert blurred == pytest.approx(np.linalg.norm([*parts, 3 * 0.2 / 25]))


def test_sides_that_no_image_shows_make_all_volumes_less_sure() -> None:
    known = [
        boll_volume_error(25.0, 8000.0, 32, scale(0.0), 1.0, conditions=Conditions(gap_deg=gap)) for gap in (0, 60, 160)
    ]
    assert known[0] == known[1]
    assert known[2] == pytest.approx(np.hypot(known[0], error_model.UNSEEN))
    bolls = [boll(8.0, 8.0 * known[2]) for _ in range(400)]
    of_plant = plant_volume_error_cm3(
        bolls, np.full(400, np.inf), scale(0.0), 0.3, conditions=Conditions(gap_deg=160.0)
    )
    assert of_plant == pytest.approx(400 * 8.0 * error_model.UNSEEN, rel=0.05)


def test_volumes_of_bolls_that_come_in_parts_are_less_sure() -> None:
    whole, parts = (
        boll_volume_error(25.0, 8000.0, 32, scale(0.0), 1.0, conditions=Conditions(joining=share)) for share in (0, 0.6)
    )
    assert parts == pytest.approx(np.hypot(whole, 0.6 * error_model.IN_PARTS))
    bolls = [boll(8.0, 8.0 * parts) for _ in range(400)]
    of_plant = plant_volume_error_cm3(bolls, np.full(400, np.inf), scale(0.0), 0.3, conditions=Conditions(joining=0.6))
    assert of_plant == pytest.approx(400 * 8.0 * 0.6 * error_model.IN_PARTS, rel=0.1), "all bolls err alike"


def test_of_a_plant_that_is_never_whole_in_view_no_error_is_known() -> None:
    bolls = [boll(8.0, 0.2)]
    assert np.isnan(
        plant_volume_error_cm3(bolls, np.array([np.inf]), scale(0.0), 0.3, conditions=Conditions(whole=False))
    )


def test_a_plant_is_blurred_where_bolls_are_few_times_as_wide_as_the_blur() -> None:
    widths_cm = np.array([4.0, np.nan, 4.2, 3.8])
    assert not blurs_bolls(0.0, 0.3, widths_cm)
    assert not blurs_bolls(3.0, 0.3, widths_cm) and blurs_bolls(4.0, 0.3, widths_cm)
    assert not blurs_bolls(4.0, 0.1, widths_cm)
    assert not blurs_bolls(9.0, 0.3, np.full(2, np.nan)) and not blurs_bolls(9.0, 0.3, np.zeros(0))


def test_shared_errors_add_up_and_own_ones_in_squares() -> None:
    shared = 0.01
    edge = 40.0 * 6 * error_model.SHARED_EDGE_PX * 0.2 / 4.0
    apart = np.full(4, np.inf)
    bolls = [boll(40.0, np.linalg.norm([3 * shared * 40.0, edge, 2.0])) for _ in range(4)]
    expected = np.sqrt((3 * shared * 160) ** 2 + (4 * edge) ** 2 + 4 * 2.0**2)
    assert plant_volume_error_cm3(bolls, apart, scale(shared), 0.2) == pytest.approx(expected)
    unknown = replace(bolls[0], volume_cm3=np.nan, volume_error_cm3=np.nan)
    with_unknown = plant_volume_error_cm3([*bolls, unknown], np.append(apart, 1.0), scale(shared), 0.2)
    assert with_unknown == pytest.approx(expected)
    assert plant_volume_error_cm3([], apart[:0], scale(shared), 0.2) == 0.0
    assert np.isnan(plant_volume_error_cm3(bolls, apart, None, 0.2))


def test_what_one_of_two_bolls_loses_to_the_other_counts_in_part(monkeypatch) -> None:
    monkeypatch.setattr(error_model, "PARTED", 1.25)
    monkeypatch.setattr(error_model, "PARTED_IN_SUM", 0.25)
    bolls = [boll(40.0, np.hypot(2.0, 8.0)), boll(30.0, np.hypot(2.0, 6.0)), boll(20.0, 2.0)]
    nearest = np.array([0.8, 0.8, np.inf])
    expected = np.linalg.norm([2.0, 2.0, 2.0, 0.25 * 8.0, 0.25 * 6.0])
    assert plant_volume_error_cm3(bolls, nearest, scale(0.0), 0.0) == pytest.approx(expected)


def test_an_interval_lies_about_what_is_expected_and_holds_what_is_stated():
    assert interval(100.0, 10.0, 5.0) == pytest.approx((85.4, 124.6))
    assert interval(100.0, 1.0, -20.0) == pytest.approx((78.04, 100.0))


def test_an_interval_is_never_negative():
    assert interval(100.0, 10.0) == pytest.approx((80.4, 119.6))
    assert interval(10.0, 10.0) == pytest.approx((0.0, 29.6))
    assert interval(np.nan, 1.0) is None
    assert interval(np.nan, 1.0, np.nan) is None
    assert interval(1.0, np.nan) is None


@pytest.mark.parametrize(("halves", "flagged"), [(None, False), ((9, 10), False), ((8, 10), True), ((49, 51), False)])
def test_halves_that_differ_by_more_than_one_boll_are_flagged(halves, flagged):
    assert halves_disagree(halves) is flagged
