# SPDX-License-Identifier: Apache-2.0
"""The stated distributions of count and volume against draws from their own model."""

from dataclasses import replace

import numpy as np
import pytest

from cotton3dg.core.measurements import BollTraits, is_counted
from cotton3dg.traits.count_distribution import (
    AS_LIKELY_AS_NOT,
    COMMON,
    HULL_OF_TWO,
    MAY_BE_NONE,
    Common,
    Possible,
    common_states,
    distribute_count,
    hidden_probability,
    miscounted_volume,
    outcomes,
)
from cotton3dg.traits.error_model import Conditions, interval

DRAWS = 20_000
SHORT_WALK = Conditions(gap_deg=280.0)


def boll(confidence: float = 1.0, *flags: str, volume_cm3: float = 40.0) -> BollTraits:
    return BollTraits(
        boll_id=1, centre_cm=np.zeros(3), volume_cm3=volume_cm3, alpha_volume_cm3=volume_cm3, diameter_cm=4.2,
        n_gaussians=100, n_views=30, confidence=confidence, flags=flags, volume_error_cm3=1.0, projected_area_cm2=14.0,
        volume_published_cm3=volume_cm3,
    )  # fmt: skip


PLANTS = {
    "sure": [boll()] * 15,
    "five of fifteen at one half": [boll()] * 10 + [boll(0.5)] * 5,
    "six of twenty at one half": [boll()] * 14 + [boll(0.5)] * 6,
    "all doubtful": [boll(0.4)] * 12,
    "perhaps none, perhaps two": [boll()] * 9 + [boll(0.9, "few_views"), boll(0.9, "too_large"), boll(0.8, "unround")],
    "some off the plant": [boll()] * 12 + [boll(1.0, "off_plant")] * 3,
    "nothing but what is off the plant": [boll(1.0, "off_plant")] * 2,
    "no volume": [boll(volume_cm3=v) for v in (30.0, 38.0, 46.0, 52.0)] * 4 + [boll(volume_cm3=np.nan)] * 3,
    "one boll": [boll(0.95)],
    "one that may be none": [boll(0.95, "too_small")],
}


def draw_states(rng: np.random.Generator) -> list[np.ndarray]:
    """The draws (n,) of each common state."""
    states = rng.choice(len(COMMON), DRAWS, p=[state.weight for state in COMMON])
    return [np.flatnonzero(states == k) for k in range(len(COMMON))]


def draw(bolls: list[BollTraits], touching: list[bool], conditions: Conditions) -> np.ndarray:
    """(DRAWS,) true counts."""
    rng, counts = np.random.default_rng(0), np.zeros(DRAWS, np.int64)
    draws_of = draw_states(rng)
    for one, touches in zip(bolls, touching, strict=True):
        for draws, state in zip(draws_of, COMMON, strict=True):
            counts[draws] += rng.choice(3, len(draws), p=outcomes(one, touches, state))
        if is_counted(one.flags):
            counts += rng.random(DRAWS) < hidden_probability(conditions)
    return counts


@pytest.mark.parametrize("touches", [False, True])
@pytest.mark.parametrize("conditions", [Conditions(), SHORT_WALK])
@pytest.mark.parametrize("name", PLANTS)
def test_the_count_is_distributed_as_draws_of_its_model(name, conditions, touches) -> None:
    bolls = PLANTS[name]
    touching = [touches] * len(bolls)
    counted = sum(is_counted(one.flags) for one in bolls)
    drawn, stated = draw(bolls, touching, conditions), distribute_count(bolls, touching, None, conditions)
    seen = np.bincount(drawn, minlength=len(stated.probabilities)) / DRAWS
    assert stated.probabilities == pytest.approx(seen, abs=0.012)
    assert stated.probabilities.sum() == pytest.approx(1.0)
    assert stated.error_about(counted) == pytest.approx(np.sqrt(((drawn - counted) ** 2).mean()), rel=0.03, abs=0.03)
    low, high = stated.interval(counted)
    assert ((low <= drawn) & (drawn <= high)).mean() > 0.948
    assert low <= counted <= high
    # Neither end can move inwards, unless the count itself is that end.
    assert low == counted or (drawn <= low).mean() > 0.02
    assert high == counted or (drawn >= high).mean() > 0.02


def test_what_was_left_out_may_be_a_boll_more() -> None:
    doubted = [Possible(0.5, 30.0), Possible(0.1, 40.0)]
    stated = distribute_count([boll()] * 9, [False] * 9, left_out=doubted)
    assert stated.probabilities[9:12] == pytest.approx([0.45, 0.5, 0.05])
    assert stated.interval(9) == (9, 11)
    assert miscounted_volume([boll()] * 9, [False] * 9, left_out=doubted).mean == pytest.approx(0.5 * 30 + 0.1 * 40)
    nothing = distribute_count([], [], left_out=doubted)
    assert nothing.interval(0) == (0, 2)


def test_a_count_that_is_sure_is_its_own_interval() -> None:
    stated = distribute_count([boll()] * 15, [False] * 15)
    assert stated.interval(15) == (15, 15) and stated.error_about(15) == 0
    assert distribute_count([boll()] * 15, [False] * 15, (15, 15)).interval(15) == (15, 15)


def test_without_a_boll_or_a_whole_plant_no_distribution_is_known() -> None:
    assert distribute_count([], []) is None
    assert distribute_count([boll()], [False], conditions=Conditions(whole=False)) is None


def test_two_parts_of_one_boll_are_one_too_many() -> None:
    """Ten pairs of parts, each pair one boll with probability 0.4: both parts state that, and the mean is right."""
    parts = [boll(0.6)] * 20
    stated = distribute_count(parts, [False] * 20, common=[Common(1.0, 0.0, are_two=False)]).probabilities
    joined = np.random.default_rng(0).binomial(10, 0.4, DRAWS)
    mean = stated @ np.arange(len(stated))
    assert mean == pytest.approx((20 - joined).mean(), abs=0.05)
    deviation = np.sqrt(stated @ (np.arange(len(stated)) - mean) ** 2)
    assert joined.std() < deviation < 1.3 * joined.std()


def test_what_bolls_have_in_common_makes_the_count_less_sure_and_certain_ones_stay_certain() -> None:
    bolls = [boll(0.85)] * 20
    alone = distribute_count(bolls, [False] * 20, common=common_states(0.0)[:1])
    alike = distribute_count(bolls, [False] * 20)
    assert sum(state.weight for state in COMMON) == pytest.approx(1.0)
    assert alike.error_about(20) > 1.3 * alone.error_about(20)
    assert distribute_count([boll()] * 20, [False] * 20, common=common_states(3.0)).interval(20) == (20, 20)


def test_halves_that_count_differently_widen_the_error() -> None:
    """Two counts drawn alike with a standard deviation of 1.5: the error that they state is right on average."""
    pairs = np.random.default_rng(0).normal(20, 1.5, (400, 2)).round().astype(int).tolist()
    plant = [boll()] * 20, [False] * 20
    stated = [distribute_count(*plant, tuple(pair)).error_about(20) ** 2 for pair in pairs]
    assert np.sqrt(np.mean(stated)) == pytest.approx(np.std(pairs), rel=0.06)


def test_halves_do_not_lead_below_no_boll() -> None:
    stated = distribute_count([boll()] * 2, [False] * 2, (0, 6))
    assert stated.probabilities.sum() == pytest.approx(1.0) and (stated.probabilities >= 0).all()
    assert stated.interval(2)[0] == 0


@pytest.mark.parametrize("conditions", [Conditions(), SHORT_WALK])
@pytest.mark.parametrize("name", [name for name, bolls in PLANTS.items() if any(is_counted(b.flags) for b in bolls)])
def test_the_volume_of_what_is_miscounted_is_that_of_draws(name, conditions) -> None:
    bolls = PLANTS[name]
    rng, missing = np.random.default_rng(0), np.zeros(DRAWS)
    draws_of = draw_states(rng)
    known = [one.volume_cm3 for one in bolls if is_counted(one.flags) and np.isfinite(one.volume_cm3)]
    for one in bolls:
        none = MAY_BE_NONE.isdisjoint(one.flags) < (rng.random(DRAWS) < AS_LIKELY_AS_NOT)
        if not np.isfinite(one.volume_cm3):
            missing += np.where(none, 0.0, rng.choice(known, DRAWS))
        elif not is_counted(one.flags):
            missing += np.where(none, 0.0, one.volume_cm3)
        else:
            two = np.zeros(DRAWS, bool)
            for draws, state in zip(draws_of, COMMON, strict=True):
                two[draws] = rng.random(len(draws)) < outcomes(one, False, state).two
            missing -= np.where(none, one.volume_cm3, 0.0) + np.where(two, HULL_OF_TWO * one.volume_cm3, 0.0)
        if is_counted(one.flags):
            missing += (rng.random(DRAWS) < hidden_probability(conditions)) * rng.choice(known, DRAWS)
    stated = miscounted_volume(bolls, [False] * len(bolls), conditions)
    assert stated.mean == pytest.approx(missing.mean(), abs=1.0)
    assert np.sqrt(stated.variance) == pytest.approx(missing.std(), rel=0.03, abs=0.1)
    # With the error of the bolls themselves, as in a plant's row.
    total, own = sum(known), 0.02 * sum(known)
    low, high = interval(total, np.hypot(own, np.sqrt(stated.variance)), stated.mean)
    true = np.maximum(total + missing + rng.normal(0.0, own, DRAWS), 0.0)
    assert ((low <= true) & (true <= high)).mean() > 0.93


def test_the_volume_of_sure_bolls_is_their_sum_whatever_the_views_say() -> None:
    """A part of a boll has its volume in the sum, however sure it is that it is a part."""
    assert miscounted_volume([boll()] * 9, [False] * 9) == (0.0, 0.0)
    none = replace(boll(), volume_cm3=np.nan)
    assert miscounted_volume([none], [False]) == (0.0, 0.0)
