# SPDX-License-Identifier: Apache-2.0
"""The measured plant: its bolls, sums and errors, and what is flagged."""

from dataclasses import replace

import numpy as np
import pytest
from scenes.measured_plant import SCALE, bolls_of, measure_plant
from scenes.table_scene import (
    BOLL_RADIUS_CM,
    BOLLS_CM,
    FOOT_CM,
    POSE,
    gaussians_at,
    joined,
    plant_points_cm,
    plant_scene,
)

from cotton3dg.core.bolls import LeftOut
from cotton3dg.core.columns import cells_of
from cotton3dg.core.scene import Gaussians
from cotton3dg.traits import boll_volume, error_model
from cotton3dg.traits import measure as measure_module
from cotton3dg.traits.boll_volume import measure_bolls
from cotton3dg.traits.corrections import still_left_out
from cotton3dg.traits.error_model import EDGE_PX, SHAPE, SHARED_EDGE_PX, UNSEEN, Conditions
from cotton3dg.traits.measure import measure_parts, measure_whole, summarise_plant


def with_ball_beside(gaussians: Gaussians, labels: np.ndarray) -> tuple[Gaussians, np.ndarray]:
    """A scene with a white ball on the table that passes for one boll more."""
    ball = np.random.default_rng(1).normal(size=(400, 3))
    ball = BOLL_RADIUS_CM * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    beside = gaussians_at(np.array([50.0, 20.0, 8.0]) + ball, 0.2)
    return joined(gaussians, beside), np.append(labels, np.full(len(ball), labels.max() + 1))


def test_what_stands_beside_the_plant_is_flagged_and_not_part_of_its_size():
    """A white ball on the table, taken for a boll, and a boll that fell between plant and rim."""
    gaussians, labels = plant_scene()
    with_ball, with_labels = with_ball_beside(gaussians, labels)
    alone = measure_plant(gaussians, bolls_of(gaussians, labels), SCALE, 0.0, 4.0)
    both = measure_plant(with_ball, bolls_of(with_ball, with_labels), SCALE, 0.0, 4.0)
    assert "bolls_off_plant" not in alone.flags
    assert "bolls_off_plant" in both.flags
    assert [boll.flags for boll in both.bolls] == [(), (), (), (), ("off_plant",)]
    assert any("boll 5" in warning for warning in both.warnings)
    for trait in ("plant_height_cm", "canopy_size_cm", "plant_height_published_cm"):
        assert getattr(both.traits, trait) == pytest.approx(getattr(alone.traits, trait), rel=1e-3)
    # The fifth is a boll of this plant as likely as not.
    assert both.traits.boll_count_error**2 == pytest.approx(alone.traits.boll_count_error**2 + 0.5, rel=0.2)
    low, high = both.traits.boll_count_interval
    assert low <= 4 and high >= 6
    assert both.traits.boll_volume_interval_cm3[1] > both.traits.boll_volume_cm3 + both.bolls[4].volume_cm3
    assert both.traits.boll_count == alone.traits.boll_count == 4
    assert "doubtful_bolls" not in both.flags
    assert both.traits.boll_volume_cm3 == pytest.approx(alone.traits.boll_volume_cm3, rel=1e-6)
    assert both.traits.boll_height_min_cm == pytest.approx(alone.traits.boll_height_min_cm)


def test_what_was_left_out_is_in_the_intervals_and_said_where_it_is():
    gaussians, labels = plant_scene()
    parts = measure_parts(gaussians, bolls_of(gaussians, labels), SCALE, 0.0, 4.0)
    faint = LeftOut(tuple(parts.bolls[0].centre_cm / SCALE.cm_per_su), 4.0 / SCALE.cm_per_su, "faint", 0.5)
    sure, unsure = measure_whole(parts), measure_whole(parts, left_out=[faint])
    assert unsure.traits.boll_count == sure.traits.boll_count
    assert unsure.traits.boll_count_error > sure.traits.boll_count_error + 0.1
    more_cm3 = unsure.traits.boll_volume_interval_cm3[1] - sure.traits.boll_volume_interval_cm3[1]
    assert more_cm3 > 0.5 * np.pi / 6 * 4.0**3
    assert "bolls_left_out" in unsure.flags and "bolls_left_out" not in sure.flags
    assert any("faint at" in warning and "4.0 cm wide" in warning for warning in unsure.warnings)
    assert "bolls_left_out" not in measure_whole(parts, left_out=[replace(faint, probability=0.1)]).flags


def test_what_a_person_added_is_no_longer_left_out():
    gaussians, labels = plant_scene()
    bolls = bolls_of(gaussians, labels)
    thing = LeftOut(tuple(bolls[1].centre), 2 * bolls[1].diameter_su, "white_thing", 0.1)
    elsewhere = replace(thing, centre_su=(90.0, 0.0, 0.0))
    assert still_left_out([thing, elsewhere], bolls) == [elsewhere]
    assert still_left_out([thing, elsewhere], bolls[:1]) == [thing, elsewhere]


def test_a_boll_that_a_person_added_is_of_the_plant_wherever_it_is():
    gaussians, labels = plant_scene()
    both, with_labels = with_ball_beside(gaussians, labels)
    bolls = bolls_of(both, with_labels)
    for added, count in (((), 4), ((5,), 5)):
        measured = measure_whole(measure_parts(both, bolls, SCALE, 0.0, 4.0, added=added))
        assert measured.traits.boll_count == count
        assert len(measured.bolls) == 5
    assert "bolls_off_plant" not in measured.flags
    halves = measure_whole(measure_parts(both, bolls, SCALE, 0.0, 4.0), halves=(5, 4)).traits.boll_count_halves
    assert halves == (4, 3)


def test_a_plant_that_no_image_shows_whole_has_no_interval(monkeypatch):
    places, labels = plant_points_cm(np.random.default_rng(0))
    gaussians = gaussians_at(places, 0.2)
    bolls = bolls_of(gaussians, labels)
    for lost in (False, True):
        monkeypatch.setattr(
            measure_module, "check_truncation", lambda *_, lost=lost: ("the frame cuts the plant", lost)
        )
        found = measure_plant(gaussians, bolls, SCALE, 0.0, 4.0)
        assert "plant_cut" in found.flags and found.traits.boll_count == 4 and found.traits.boll_volume_cm3 > 0
        intervals = found.traits.boll_count_interval, found.traits.boll_volume_interval_cm3
        assert (intervals == (None, None)) == lost
        assert np.isnan(found.traits.boll_count_error) == np.isnan(found.traits.boll_volume_error_cm3) == lost


def test_a_side_that_was_not_filmed_widens_the_volumes_of_plant_and_bolls():
    places, labels = plant_points_cm(np.random.default_rng(0))
    gaussians = gaussians_at(places, 0.2)
    whole, half = (
        measure_plant(gaussians, bolls_of(gaussians, labels), SCALE, 0.0, 4.0, conditions=Conditions(gap_deg=gap))
        for gap in (20.0, 160.0)
    )
    volume, more = whole.traits.boll_volume_cm3, UNSEEN * whole.traits.boll_volume_cm3
    assert half.traits.boll_volume_cm3 == volume
    assert half.traits.boll_volume_error_cm3 == pytest.approx(np.hypot(whole.traits.boll_volume_error_cm3, more))
    for boll, seen in zip(half.bolls, whole.bolls, strict=True):
        expected = np.hypot(seen.volume_error_cm3, UNSEEN * seen.volume_cm3)
        assert boll.volume_error_cm3 == pytest.approx(expected)


def test_specks_beyond_a_lost_twig_are_flagged_and_widen_the_interval():
    """Three specks in a row outwards from a boll; many that stand close are a thing of their own, or a noisy model."""
    places, labels = plant_points_cm(np.random.default_rng(0))
    gaussians = gaussians_at(places, 0.2)
    top = places[labels > 0][places[labels > 0][:, 0].argmax()]
    bolls = bolls_of(gaussians, labels)
    alone = measure_plant(gaussians, bolls, SCALE, 0.0, 4.0)
    specks = joined(gaussians, gaussians_at(top + [[5, 0, 1], [8, 0, 1.5], [11, 0, 2.0]], 0.1))
    flagged = measure_plant(specks, bolls, SCALE, 0.0, 4.0)
    assert "lost_tips" in flagged.flags and "lost_tips" not in alone.flags
    assert any("canopy" in warning for warning in flagged.warnings)
    assert flagged.traits.canopy_size_cm == alone.traits.canopy_size_cm
    assert flagged.traits.canopy_size_interval_cm[1] > alone.traits.canopy_size_cm + 4
    assert flagged.traits.plant_height_error_cm == pytest.approx(alone.traits.plant_height_error_cm)
    thick = joined(gaussians, gaussians_at(top + [[5, 0, 1], [8, 0, 1.5], [11, 0, 2.0]], 0.4))
    assert "lost_tips" not in measure_plant(thick, bolls, SCALE, 0.0, 4.0).flags
    post = top + [8.0, 0, 0] + np.linspace([0, 0, -4.0], [0, 0, 4.0], 40)
    noise = top + np.random.default_rng(0).uniform([3, -9, -9], [11, 9, 9], (40, 3))
    for others in (post, noise):
        assert (
            "lost_tips" not in measure_plant(joined(gaussians, gaussians_at(others, 0.1)), bolls, SCALE, 0.0, 4.0).flags
        )


@pytest.mark.slow
def test_a_twig_that_only_the_photos_show_is_measured_to_its_end():
    places, labels = plant_points_cm(np.random.default_rng(0))
    gaussians = gaussians_at(places, 0.2)
    bolls = bolls_of(gaussians, labels)
    alone = measure_plant(gaussians, bolls, SCALE, 0.0, 4.0).traits
    outermost = places[places[:, 0].argmax()]
    way = POSE.scene(outermost + np.linspace([0, 0, 0], [10.0, 0, 0], 41))
    found = measure_plant(gaussians, bolls, SCALE, 0.0, 4.0, thin_ends=[way])
    assert "thin_ends" in found.flags and any("1 followed" in warning for warning in found.warnings)
    # The mean of two sides; the least rectangle may turn a little.
    assert 5 <= found.traits.canopy_size_cm - alone.canopy_size_cm < 7
    # Its last centimetre is half of one in the mean of two sides.
    assert np.sqrt(found.traits.canopy_size_error_cm**2 - alone.canopy_size_error_cm**2) == pytest.approx(0.5, abs=0.15)
    assert found.traits.plant_height_cm == alone.plant_height_cm
    assert found.traits.boll_volume_cm3 == alone.boll_volume_cm3

    upwards = POSE.scene(places[places[:, 2].argmax()] + np.linspace([0, 0, 0], [0, 0, 8.0], 33))
    higher = measure_plant(gaussians, bolls, SCALE, 0.0, 4.0, thin_ends=[upwards]).traits
    assert higher.plant_height_cm - alone.plant_height_cm == pytest.approx(7.5, abs=0.5)
    assert higher.plant_height_interval_cm[0] < higher.plant_height_cm - 1.9

    inside = POSE.scene(np.linspace([4.0, -3, 30], [6, -3, 35], 20))
    within = measure_plant(gaussians, bolls, SCALE, 0.0, 4.0, thin_ends=[inside])
    assert "thin_ends" not in within.flags and within.traits.canopy_size_cm == alone.canopy_size_cm


@pytest.mark.slow
def test_the_faint_end_of_a_twig_is_flagged_and_widens_the_interval():
    places, labels = plant_points_cm(np.random.default_rng(0))
    gaussians = gaussians_at(places, 0.2)
    bolls = bolls_of(gaussians, labels)
    alone = measure_plant(gaussians, bolls, SCALE, 0.0, 4.0)
    top = places[labels > 0][places[labels > 0][:, 0].argmax()]
    twig = gaussians_at(top + np.linspace([0.2, 0, 0.1], [6, 0, 1.5], 30), 0.1)
    for opacity, flagged in ((0.15, True), (0.05, False), (0.5, False)):
        faint = replace(twig, opacity_logits=np.full(len(twig), np.log(opacity / (1 - opacity)), np.float32))
        found = measure_plant(joined(gaussians, faint), bolls, SCALE, 0.0, 4.0)
        assert ("lost_tips" in found.flags) == flagged, opacity
        if opacity < 0.2:
            assert found.traits.canopy_size_cm == pytest.approx(alone.traits.canopy_size_cm, abs=0.1)
        else:
            assert found.traits.canopy_size_cm > alone.traits.canopy_size_cm + 2
        if flagged:
            assert found.traits.canopy_size_interval_cm[1] > alone.traits.canopy_size_cm + 2


def test_bolls_in_the_air_belong_to_the_plant_whatever_is_missing_below_them():
    """A coarse model of which only the stem's foot and the bolls are left."""
    gaussians, labels = plant_scene()
    places = POSE.cm(gaussians.means)
    bare = gaussians[(labels > 0) | (places[:, 2] < 14.0)]
    left = labels[(labels > 0) | (places[:, 2] < 14.0)]
    measured = measure_plant(bare, bolls_of(bare, left), SCALE, 0.0, 4.0)
    assert "bolls_off_plant" not in measured.flags
    assert measured.traits.plant_height_cm > 50


@pytest.fixture(scope="module")
def measured():
    """The scene's bolls as they are measured with a scale and a foot."""
    gaussians, labels = plant_scene()
    return measure_bolls(gaussians, bolls_of(gaussians, labels), SCALE, POSE.scene(FOOT_CM[None])[0])


def test_bolls_have_their_volume_place_and_diameter(measured):
    for boll, centre in zip(measured, BOLLS_CM, strict=True):
        assert boll.volume_cm3 == pytest.approx(4 / 3 * np.pi * BOLL_RADIUS_CM**3, rel=0.05)
        assert boll.alpha_volume_cm3 == pytest.approx(boll.volume_cm3, rel=0.05)
        assert boll.diameter_cm == pytest.approx(2 * BOLL_RADIUS_CM, rel=0.02)
        assert boll.centre_cm == pytest.approx(centre - FOOT_CM, abs=0.3)
        assert boll.n_views == 2


def test_a_boll_that_touches_another_is_as_large_and_less_sure(measured, monkeypatch):
    gaussians, labels = plant_scene()
    monkeypatch.setattr(
        boll_volume, "nearest_neighbours", lambda centres, diameters: np.array([np.inf, 1.15, 0.9, 0.9])
    )
    touching = measure_bolls(gaussians, bolls_of(gaussians, labels), SCALE, None)
    for boll, alone in zip(touching, measured, strict=True):
        assert (boll.volume_cm3, boll.diameter_cm) == (alone.volume_cm3, alone.diameter_cm)
    assert touching[2].volume_error_cm3 > 2 * measured[2].volume_error_cm3


def test_bolls_as_low_as_the_clamp_are_flagged(measured):
    gaussians, labels = plant_scene()
    foot = POSE.scene(FOOT_CM[None])[0]
    heights = BOLLS_CM[:, 2] - FOOT_CM[2]
    clamp_cm = np.sort(heights)[:2].mean() / 1.5
    traits = measure_bolls(gaussians, bolls_of(gaussians, labels), SCALE, foot, clamp_cm=clamp_cm)
    assert [boll.flags == ("near_clamp",) for boll in traits] == (heights == heights.min()).tolist()
    assert not any(boll.flags for boll in measured)


@pytest.mark.parametrize(("factor", "flag"), [(0.5, "too_small"), (2.0, "too_large")])
def test_bolls_of_unlikely_sizes_are_flagged(factor, flag):
    gaussians, labels = plant_scene()
    scale = replace(SCALE, cm_per_su=factor * 4.5 / (2 * BOLL_RADIUS_CM) * SCALE.cm_per_su)
    traits = measure_bolls(gaussians, bolls_of(gaussians, labels), scale, POSE.scene(FOOT_CM[None])[0])
    assert all(flag in boll.flags for boll in traits)
    assert "doubtful_bolls" in summarise_plant(traits, None, scale).flags


def test_without_a_scale_only_counts_are_given():
    gaussians, labels = plant_scene()
    traits = measure_bolls(gaussians, bolls_of(gaussians, labels), None, None)
    assert [boll.n_gaussians for boll in traits] == [400] * 4
    row = summarise_plant(traits, None, None)
    assert row.boll_count == 4
    metric = [v for k, v in vars(row).items() if k.endswith(("_cm", "_cm2", "_cm3"))]
    assert len(metric) > 20
    assert all(value is None or np.isnan(value) for value in metric)
    assert row.flags == ()
    assert row.bolls_by_third is None


def test_no_bolls_have_no_volume_and_unknown_ones_no_known(measured):
    empty = summarise_plant([], None, SCALE)
    assert empty.boll_count == 0
    of_volume = (empty.boll_volume_cm3, empty.boll_volume_error_cm3, empty.boll_volume_published_cm3)
    assert np.isnan([*of_volume, empty.boll_volume_mean_cm3, empty.lint_area_cm2]).all()
    assert empty.boll_volume_interval_cm3 is None
    broken = replace(measured[0], volume_cm3=np.nan)
    some = summarise_plant([broken, *measured[1:]], None, SCALE)
    assert some.boll_volume_cm3 == pytest.approx(sum(boll.volume_cm3 for boll in measured[1:]))
    assert some.boll_volume_mean_cm3 == pytest.approx(some.boll_volume_cm3 / 3)
    assert some.flags == ("bolls_without_volume",)
    assert cells_of(some)["boll_count"] == len(measured)  # flags go into the row by another way
    none = summarise_plant([broken], None, SCALE)
    assert np.isnan(none.boll_volume_cm3)


def test_errors_of_volumes_add_up_as_far_as_bolls_share_them(measured, monkeypatch):
    gaussians, labels = plant_scene()
    bolls = [replace(boll, confidence=1.0) for boll in bolls_of(gaussians, labels)[:2]]
    volumes = np.array([boll.volume_cm3 for boll in measured])

    def by_shape(bolls):
        balls = np.array([np.pi / 6 * boll.diameter_cm**3 for boll in bolls])
        return SHAPE * (1 - [boll.volume_cm3 for boll in bolls] / balls) * [boll.volume_cm3 for boll in bolls]

    own = by_shape(measured)
    shared = 3 * SCALE.relative_error * volumes.sum()
    by_scale = summarise_plant([replace(boll, confidence=1.0) for boll in measured], None, SCALE)
    by_edge = error_model.LINT_EDGE * volumes.sum()
    assert by_scale.boll_volume_error_cm3 == pytest.approx(np.linalg.norm([*own, shared, by_edge]))
    monkeypatch.setattr(error_model, "LINT_EDGE", 0.0)
    exact = replace(SCALE, relative_error=0.0)
    pixel_su = 0.1 / POSE.cm_per_su
    traits = measure_bolls(gaussians, bolls, exact, None, pixel_su)
    pixels = np.array([3 * boll.volume_cm3 * 0.1 / boll.diameter_cm for boll in traits])
    own = np.hypot(EDGE_PX * pixels, by_shape(traits))
    edges = 2 * SHARED_EDGE_PX * pixels
    assert [boll.volume_error_cm3 for boll in traits] == pytest.approx(np.hypot(own, edges))
    by_pixels = summarise_plant(traits, None, exact, pixel_su)
    assert by_pixels.boll_volume_error_cm3 == pytest.approx(np.hypot(np.linalg.norm(own), edges.sum()))


def test_a_boll_that_is_perhaps_two_has_a_flag_and_larger_errors(measured, monkeypatch):
    gaussians, labels = plant_scene()
    bolls = bolls_of(gaussians, labels)
    sure = measure_bolls(gaussians, bolls, SCALE, None)
    monkeypatch.setattr(boll_volume, "find_unround", lambda nearest, roundness: np.arange(len(nearest)) == 1)
    doubted = measure_bolls(gaussians, bolls, SCALE, None)
    assert [boll.flags for boll in doubted] == [boll.flags + ("unround",) * (i == 1) for i, boll in enumerate(sure)]
    wider = [boll.volume_error_cm3 > before.volume_error_cm3 for boll, before in zip(doubted, sure, strict=True)]
    assert wider == [i == 1 for i in range(len(bolls))]
    of_sure, of_doubted = (summarise_plant(some, None, SCALE) for some in (sure, doubted))
    assert of_doubted.boll_count_error > of_sure.boll_count_error + 0.2
    assert of_doubted.boll_volume_error_cm3 > of_sure.boll_volume_error_cm3
    assert (of_doubted.boll_count, of_doubted.boll_volume_cm3) == (of_sure.boll_count, of_sure.boll_volume_cm3)
    assert "doubtful_bolls" in of_doubted.flags and "doubtful_bolls" not in of_sure.flags
