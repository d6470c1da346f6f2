"""Which parts are joined to one boll, and which are none."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scenes.splat_scenes import round_gaussians

from cotton3dg.masks.join_parts import (
    CLOSE,
    DIVIDES,
    FITS,
    NEAR,
    UNDECIDED,
    USUAL,
    Join,
    find_contacts,
    find_near_pairs,
    join_pair,
    join_parts,
    measure_borders,
    measure_widths,
)
from cotton3dg.masks.lint_in_space import LintInSpace
from cotton3dg.masks.meeting_votes import Middles, Votes, drop_unlikely


def touching_pair(
    apart: float, border: float, probability: float = 0.9, lonely: tuple[float, ...] = (1, 1)
) -> tuple[Middles, list[Votes], LintInSpace]:
    """Two balls of lint of diameter 1 whose middles are `apart`, beside lonely ones; seen from four sides."""
    rng = np.random.default_rng(1)
    far = [[9 * (k + 1), 0, 0] if k % 2 == 0 else [0, 9 * k, 0] for k in range(len(lonely))]
    centres, sizes = np.array([[0, 0, 0], [apart, 0, 0], *far]), np.array([1, 1, *lonely])
    shell = rng.normal(size=(400, 3))
    shell *= 0.5 / np.linalg.norm(shell, axis=1, keepdims=True)
    gaussians = round_gaussians((centres[:, None] + sizes[:, None, None] * shell).reshape(-1, 3), 0.05)
    n = len(gaussians)
    rows = np.argsort(gaussians.means[:, 0], kind="stable")
    view = view_of((n // 40, 40), np.divmod(np.arange(n), 40), np.full(n, border), gaussians.means[rows], probability)
    ones = np.ones(len(centres), np.float32)
    middles = Middles(centres.astype(np.float32), ones, ones, np.full(len(centres), 4))
    return middles, [view] * 4, LintInSpace(gaussians, np.ones(n, np.float32), np.zeros(3, np.float32))


def view_of(shape, pixels, borders: np.ndarray, surfaces: np.ndarray, probability: float = 0.9) -> Votes:
    """A view as far as the joining of parts reads it."""
    n = len(surfaces)
    nothing, ones = np.zeros((n, 3), np.float32), np.ones(n, np.float32)
    return Votes(
        shape, pixels, borders.astype(np.float32), nothing, surfaces.astype(np.float32), nothing, np.zeros(3),
        ones, probability * ones, ones,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("apart", "border", "bolls"),
    [(0.4, 0.3, 3), (0.4, 0.9, 4), (0.85, 0.4, 4), (0.85, 0.6, 4), (0.7, 0.36, 3), (0.7, 0.55, 4)],
    ids=[
        "locks of one boll",
        "small bolls with a clear border",
        "bolls that touch",
        "bolls that touch, with a border",
        "a long boll",
        "bolls that lie in each other",
    ],
)
def test_parts_are_joined_where_both_are_no_wider_than_a_boll(apart, border, bolls):
    middles = join_parts(*touching_pair(apart, border))
    assert len(middles.centres) == bolls
    if bolls == 3:
        np.testing.assert_allclose(middles.centres[0], [apart / 2, 0, 0], atol=1e-6)
        assert middles.support[0] == 2


def test_in_crowds_two_near_middles_are_two_bolls():
    given = touching_pair(0.7, 0.36)
    assert len(join_parts(*given, close=-np.inf).centres) == 4
    assert len(join_parts(*given).centres) == 3


def test_a_few_things_that_are_larger_make_no_bolls_that_touch_one():
    middles = join_parts(*touching_pair(0.95, UNDECIDED, lonely=(1, 1, 1, 1.8, 1.8, 1.8)))
    assert len(middles.centres) == 8


def heap(seed: int, count: int) -> tuple[Middles, list[Votes], LintInSpace]:
    """Bolls of many sizes in a heap, much of which belongs together, and six cuts through it."""
    rng = np.random.default_rng(seed)
    side = 0.9 * np.cbrt(count)
    centres, sizes = side * rng.uniform(size=(count, 3)), rng.uniform(0.6, 1.4, count)
    lint = (centres[:, None] + 0.2 * sizes[:, None, None] * rng.normal(size=(count, 50, 3))).reshape(-1, 3)
    votes = []
    for number in range(6):
        shape = (50, 70)
        pixels = np.nonzero(rng.random(shape) < 0.8)
        cut = np.column_stack([pixels[0] / 50, pixels[1] / 70, np.full(len(pixels[0]), rng.uniform())])
        surfaces = side * np.roll(cut, number, axis=1) + rng.normal(0, 0.02, cut.shape)
        votes.append(view_of(shape, pixels, 0.5 * rng.random(len(cut)) ** 2, surfaces))
    middles = Middles(
        centres.astype(np.float32), sizes.astype(np.float32), rng.uniform(1, 5, count).astype(np.float32),
        rng.integers(3, 9, count),
    )  # fmt: skip
    gaussians = round_gaussians(lint, 0.05)
    return middles, votes, LintInSpace(gaussians, np.ones(len(lint), np.float32), np.zeros(3, np.float32))


def measure_all_borders(middles: Middles, votes: list[Votes]) -> dict[tuple[int, int], float]:
    """In the images themselves, of all pairs of bolls."""
    count = len(middles.centres) + 1
    total, pixels = np.zeros(count * count), np.zeros(count * count)
    for view in votes:
        ids, border = np.zeros(view.shape, np.uint16), np.zeros(view.shape, np.float32)
        ids[view.pixels], border[view.pixels] = middles.nearest(view.surfaces), view.borders
        border = cv2.dilate(border, np.ones((5, 5), np.uint8))
        for first, second in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
            meet = (ids[first] != ids[second]) & (ids[first] > 0) & (ids[second] > 0)
            ends = np.sort(np.stack([ids[first][meet], ids[second][meet]]).astype(np.int64), axis=0)
            total += np.bincount(ends[0] * count + ends[1], border[first][meet], count * count)
            pixels += np.bincount(ends[0] * count + ends[1], minlength=count * count)
    return {divmod(int(pair), count): float(total[pair] / pixels[pair]) for pair in np.flatnonzero(pixels)}


def join_slowly(middles: Middles, votes: list[Votes], lint: LintInSpace) -> Middles:
    """As `join_parts`, but everything is measured anew after each join."""
    places = lint.gaussians.means
    owners = middles.nearest(places)
    usual = np.quantile([measure_widths(places[owners == k + 1])[0] for k in range(len(middles.centres))], USUAL)
    while True:
        owners, borders = middles.nearest(places), measure_all_borders(middles, votes)
        scores = {
            (a, b): min(
                measure_widths(places[np.isin(owners, (a + 1, b + 1))])[1] / usual - FITS,
                np.linalg.norm(middles.centres[a] - middles.centres[b]) / usual - CLOSE,
            )
            + DIVIDES * (borders[a + 1, b + 1] - UNDECIDED)
            for a, b in find_near_pairs(middles.centres, NEAR * usual)
            if (a + 1, b + 1) in borders
        }
        pair = min(scores, key=scores.__getitem__, default=None)
        if pair is None or scores[pair] >= 0:
            return middles
        middles = join_pair(middles, *pair)


@pytest.mark.parametrize(("seed", "count"), [(1, 20), (2, 40), (3, 40)])
def test_parts_are_joined_as_if_all_were_measured_anew_each_time(seed, count):
    given = heap(seed, count)
    expected, found = join_slowly(*given), join_parts(*given)
    assert len(found.centres) < count
    for name, values in vars(expected).items():
        np.testing.assert_array_equal(getattr(found, name), values)


def test_a_join_changes_no_measure_but_those_that_are_taken_anew():
    middles, votes, _ = heap(0, 40)
    contacts = [find_contacts(view) for view in votes]
    seen = [middles.nearest(view.surfaces) for view in votes]
    borders = measure_borders(contacts, seen)
    assert borders == measure_all_borders(middles, votes)
    for _ in range(15):
        join = Join(middles, *find_near_pairs(middles.centres, 1.0)[0])
        middles = join.after
        found = [join.find_owners(ids, view.surfaces) for ids, view in zip(seen, votes, strict=True)]
        seen, touched = [ids for ids, _ in found], np.unique(np.concatenate([ids for _, ids in found]))
        assert len(touched) < len(middles.centres)
        borders = join.keep(borders, touched) | measure_borders(contacts, seen, touched)
        assert borders == measure_all_borders(middles, votes)


@pytest.mark.parametrize(("probability", "support", "bolls"), [(0.5, 0.1, 0), (0.5, 1.0, 4), (0.8, 0.1, 4)])
def test_what_few_votes_are_for_is_no_boll_where_it_hardly_looks_like_lint(probability, support, bolls):
    middles, votes, _ = touching_pair(0.85, 0.3, probability)
    middles = replace(middles, support=np.full(4, support, np.float32))
    assert len(drop_unlikely(middles, votes).centres) == bolls
