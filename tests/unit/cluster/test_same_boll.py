# SPDX-License-Identifier: Apache-2.0
"""Which parts are one boll: what is measured of them, the scores, and what joins."""

import math
from dataclasses import replace

import numpy as np
import pytest
from same_boll import TERMS, calibrate, fit_deviation, write_score
from scenes.seen_balls import Ball, see

from cotton3dg.cluster.boll_parts import gain_of_two, gather_parts, join_two, measure_pair
from cotton3dg.cluster.hough_voting import Middles, find_faint
from cotton3dg.cluster.join_parts import join_parts
from cotton3dg.cluster.same_boll import USUAL_JOINING, Calibration, PairMeasures, Score, Term, logistic, read_score
from cotton3dg.cluster.separate_bolls import find_joining, separate_bolls

TOUCHING = [Ball((0, 0, 0), 2.3), Ball((4.4, 0, 0), 2.3)]
UP = np.array([0.0, 0.0, 1.0])
NEUTRAL = Term("joining", 0.0, 0.0)
BUR = (0.0, 0.0, 0.0)
LOCKS = [
    Ball((1.3, 0, 0), 1.2, (0.6, 0, 0)),
    Ball((-0.65, 1.1, 0), 1.2, (-0.3, 0.5, 0)),
    Ball((-0.65, -1.1, 0), 1.2, (-0.3, -0.5, 0)),
]


def middles_of(balls: list[Ball]) -> Middles:
    n = len(balls)
    aims = np.array([ball.aim or ball.centre for ball in balls], np.float32)
    said = np.array([ball.said for ball in balls], np.float32)
    return Middles(aims, said, np.ones(n, np.float32), np.full(n, 12))


def parts_of(balls: list[Ball]):
    votes, lint = see(balls)
    middles = middles_of(balls)
    return gather_parts(middles, votes, lint)


def test_two_balls_are_measured_as_they_are():
    parts = parts_of(TOUCHING)
    measures = measure_pair(parts[0], parts[1], UP, cm_per_su=1.0)
    assert measures.two_middles > 1
    assert measures.sideways_cm == pytest.approx(4.4, abs=0.2)
    assert measures.below_cm == pytest.approx(0, abs=0.2)
    on_its_side = measure_pair(parts[0], parts[1], np.array([3.0, 4.0, 0.0]), cm_per_su=1.0)
    assert on_its_side.sideways_cm == pytest.approx(0.8 * 4.4, abs=0.2)
    assert on_its_side.below_cm == pytest.approx(0.6 * 4.4, abs=0.2)
    twice = measure_pair(parts[0], parts[1], UP, cm_per_su=2.0)
    lengths = {name: 2 * getattr(measures, name) for name in measures._fields if name.endswith("_cm")}
    assert twice == pytest.approx(measures._replace(**lengths), abs=1e-3)


def test_the_votes_of_one_middle_are_not_better_explained_by_two():
    """Two locks at either side of the bur: taken for two parts, their votes meet in the bur all the same."""
    locks = [Ball((x, 0, 0), 1.2, BUR) for x in (-1.0, 1.0)]
    votes, lint = see(locks)
    parts = gather_parts(middles_of([replace(lock, aim=None) for lock in locks]), votes, lint)
    assert gain_of_two(parts[0], parts[1]) < 0.1 < gain_of_two(*parts_of(TOUCHING).values())


def test_joined_parts_keep_what_was_seen_of_both():
    parts = parts_of(LOCKS)
    whole = join_two(parts[0], parts[1])
    assert len(whole.lint) == len(parts[0].lint) + len(parts[1].lint)
    assert whole.weights.sum() == pytest.approx(1, abs=1e-5)
    assert whole.support == 2


def test_a_part_without_lint_lies_where_its_votes_meet():
    part = replace(parts_of(LOCKS)[0], lint=np.zeros((0, 3), np.float32))
    assert (part.lint_middle == part.centre).all()


@pytest.mark.parametrize(("measure", "sign"), TERMS.items())
def test_the_fitted_score_goes_where_physics_says(measure, sign):
    """Farther beside, with votes that meet in two places: less likely one boll."""
    usual = PairMeasures(sideways_cm=2.0, below_cm=2.0, two_middles=0.5)
    more = usual._replace(**{measure: getattr(usual, measure) + 0.2})
    score = read_score().of_plant(USUAL_JOINING)
    assert sign * (score.probability(more) - score.probability(usual)) >= 0
    near, far = PairMeasures(1.0, 1.0, 0.1), PairMeasures(4.0, 2.0, 1.0)
    assert score.probability(near) > 0.5 > score.probability(far)


def test_a_lock_below_is_rather_of_the_boll_than_a_neighbour_beside_it():
    """Both 4.5 cm away, with votes that two middles explain alike, where bolls come in parts."""
    parts = read_score().of_plant(0.5)
    assert parts.probability(PairMeasures(0.7, 4.4, 0.6)) > 0.5 > parts.probability(PairMeasures(4.4, 0.7, 0.6))


def test_what_lies_below_a_boll_is_a_lock_where_bolls_come_in_parts_and_a_small_boll_where_none_does():
    """A pair of the touching set: the lower lint 3.6 cm below and hardly beside, both wide; it was joined before."""
    below = PairMeasures(sideways_cm=0.7, below_cm=3.6, two_middles=0.75)
    whole, parts = (read_score().of_plant(joining) for joining in (0.05, 0.5))
    assert parts.probability(below) > 0.5 > whole.probability(below)

    for share, less in ((0.2, 1), (0.9, 0)):
        score = read_score().of_plant(share)
        one, two = (score.probability(below._replace(two_middles=gain)) for gain in (0.2, 0.8))
        assert (one > two) == less and one >= two, "two middles never speak for one boll"


@pytest.mark.parametrize("measures", [(2.5, 0.8, 0.06), (2.2, 1.3, 0.24), (1.8, 0.6, 0.19), (2.2, 1.7, 0.13)])
def test_two_sides_of_one_boll_join_where_most_bolls_are_whole(measures):
    """Pairs of path-traced plants, which a share of joining parts that counts for every pair alike kept apart."""
    assert read_score().of_plant(0.15).probability(PairMeasures(*measures)) > 0.5


def test_the_score_of_a_plant_is_the_score_with_its_product():
    score = Score(
        -1.0, (Term("sideways_cm", 4.0, -1.0), Term("two_middles", 0.9, -7.0)), Term("joining", 0.4, 12.0), 0.2
    )
    odds = -1 - (2.5 - 4) - 7 * (0.6 - 0.9) + 12 * (0.6 * 0.35 - 0.4)
    assert score.of_plant(0.35).probability(PairMeasures(2.5, 1.0, 0.6)) == pytest.approx(logistic(odds))


def test_the_share_of_parts_that_join():
    """Three bolls of three locks each; then the same locks, so far apart that each is a boll."""
    by_distance = Score(0.0, (Term("sideways_cm", 3.5, -1.0),), NEUTRAL, 0.25)
    for spread, share in ((1.0, 2 / 3), (6.0, 0.0)):
        balls = [
            replace(ball, centre=tuple(spread * x + 30 * k * (n == 0) for n, x in enumerate(ball.centre)))
            for k in range(3)
            for ball in LOCKS
        ]
        parts = parts_of([replace(ball, aim=None) for ball in balls])
        assert find_joining(parts, UP, 1.0, by_distance) == pytest.approx(share)


def test_what_is_stated_too_carefully_is_calibrated(monkeypatch):
    """Of what states 0.4 nine in ten come true, of what states 0.9 all but one in a hundred."""
    stated = [(0.4, int(k % 10 > 0)) for k in range(200)] + [(0.9, int(k % 100 > 0)) for k in range(200)]
    monkeypatch.setattr("same_boll.outcomes", lambda *_: stated)
    one_boll = calibrate(Score(0.0, (), NEUTRAL, 0.25), [None]).one_boll
    assert one_boll.probability(1.0) == 1.0, "nothing near it speaks against one boll"
    assert one_boll.probability(0.4) == pytest.approx(0.9, abs=0.01)
    assert one_boll.probability(0.9) == pytest.approx(0.99, abs=0.01)


def test_a_score_is_read_as_it_was_written(tmp_path):
    terms = (Term("sideways_cm", 3.5, -1.0), Term("two_middles", 0.4, 0.0))
    score = Score(-1.5, terms, Term("joining", 0.5, 6.0), 0.3, Calibration(0.25, 0.5))
    write_score(tmp_path / "score.toml", score, 3)
    assert read_score(tmp_path / "score.toml") == score


def test_the_likeliest_pair_joins_first_and_what_is_left_keeps_its_probability():
    """Of four balls in a row at 2, 3 and 6 cm: by distance alone, even at 3.5 cm."""
    balls = [Ball((x, 0, 0), 1.0) for x in (0, 2, 5, 11)]
    parts = parts_of(balls)
    score = Score(0.0, (Term("sideways_cm", 3.5, -1.0),), NEUTRAL, 0.25)
    joined = join_parts(parts, UP, 1.0, score.probability)
    assert sorted(joined.parts) == [0, 2, 3], "the nearest two are one, and that is farther from the third"
    middle = joined.parts[0].centre
    assert 0.5 < middle[0] < 1.5
    assert joined.joins == {0: pytest.approx(1 / (1 + math.exp(2 - 3.5)), abs=0.03)}
    assert joined.pairs[0, 2] == pytest.approx(1 / (1 + math.exp(5 - joined.parts[0].lint_middle[0] - 3.5)), abs=0.03)
    assert joined.one_boll(0) == pytest.approx(joined.joins[0] * (1 - joined.pairs[0, 2]))
    assert joined.one_boll(3) == pytest.approx(1 - joined.pairs[2, 3])


def test_locks_of_one_boll_join():
    bolls, _, joining = separate_bolls(*see(LOCKS), UP, cm_per_su=1.0)
    assert len(bolls.centres) == 1 and joining >= 0.5
    np.testing.assert_allclose(bolls.centres[0], BUR, atol=0.3)
    assert bolls.one_boll[0] > 0.5


def test_bolls_that_touch_stay_two():
    bolls, _, joining = separate_bolls(*see(TOUCHING), UP, cm_per_su=1.0)
    assert len(bolls.centres) == 2 and joining == 0
    assert (bolls.one_boll > 0.5).all()


def test_the_nearer_two_bolls_lie_the_less_sure_they_are_two():
    near, far = (
        separate_bolls(
            *see([TOUCHING[0], replace(TOUCHING[1], centre=(apart, 0, 0))], scatter=0.8), UP, cm_per_su=1.0
        ).bolls
        for apart in (3.4, 4.0)
    )
    assert len(near.centres) == len(far.centres) == 2
    assert near.one_boll.max() < far.one_boll.min()


@pytest.mark.parametrize("zoom", [0.1, 10.0])
def test_without_a_scale_the_unit_of_length_does_not_matter(zoom):
    votes, lint = see(TOUCHING)
    in_other_units = [
        replace(view, **{name: zoom * getattr(view, name) for name in ("places", "surfaces", "eye", "diameters")})
        for view in votes
    ]
    model = replace(lint.gaussians, means=np.float32(zoom) * lint.gaussians.means)
    bolls = separate_bolls(in_other_units, replace(lint, gaussians=model), UP).bolls
    expected = separate_bolls(votes, lint, UP).bolls
    np.testing.assert_allclose(bolls.centres, zoom * expected.centres, rtol=1e-3, atol=1e-3 * zoom)
    np.testing.assert_allclose(bolls.one_boll, expected.one_boll, atol=0.02)


@pytest.mark.parametrize(("probability", "support", "bolls"), [(0.5, 0.1, 0), (0.5, 1.0, 2), (0.8, 0.1, 2)])
def test_what_few_votes_are_for_is_no_boll_where_it_hardly_looks_like_lint(probability, support, bolls):
    votes, _ = see([replace(ball, probability=probability) for ball in TOUCHING])
    middles = replace(middles_of(TOUCHING), support=np.full(2, support, np.float32))
    assert (~find_faint(middles, votes)).sum() == bolls


def test_without_votes_there_are_no_bolls():
    votes, lint = see(TOUCHING)
    none = [view.take(np.zeros(len(view.rays), bool)) for view in votes]
    bolls, _, joining = separate_bolls(none, lint, UP)
    assert bolls.centres.shape == (0, 3) and not len(bolls.one_boll) and joining == 0


@pytest.mark.parametrize("true", [0.0, 1.0])
def test_the_deviation_between_plants_is_found(true):
    rng = np.random.default_rng(3)
    plants = []
    for _ in range(400):
        shift = rng.normal(0, true)
        odds = rng.normal(1.5, 1, 15)
        one = rng.random(15) < [logistic(value + shift) for value in odds]
        plants.append([(logistic(value), int(so)) for value, so in zip(odds, one, strict=True)])
    assert fit_deviation(plants) == pytest.approx(true, abs=0.2)


def test_bolls_that_are_certain_say_nothing_of_it():
    assert fit_deviation([[(1.0, 1)] * 9, []]) == 0
