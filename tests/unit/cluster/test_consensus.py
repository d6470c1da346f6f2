# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes.orbit_scene import Scene, degraded_masks, exact_masks, f1_at_half, layers, make_scene, orbit, weights_of

from cotton3dg.cluster.boll_shape import flag_close, split_heap
from cotton3dg.cluster.consensus import contract, join_halves, merge_views, move_nodes
from cotton3dg.core.bolls import BollInstance, LiftedMasks
from cotton3dg.evaluation.match import match_bolls
from cotton3dg.geometry.point_sets import find_compact_part, measure_extent
from cotton3dg.segment.lift import ViewWeights, lift, mark_rim, rim_width_px

UP = np.array([0, 0, 1.0])


@cache
def drawn(seed: int, n_views: int = 36):
    scene = make_scene(seed)
    cameras = orbit(n_views)
    return scene, cameras, [layers(scene, camera) for camera in cameras]


def lifted(seed: int, n_views: int = 36, **degradation) -> tuple[Scene, np.ndarray, LiftedMasks]:
    """A scene, which of its Gaussians are seen, and its degraded masks lifted onto them."""
    scene, cameras, drawings = drawn(seed, n_views)
    rng = np.random.default_rng(seed + 100)
    masks = [degraded_masks(scene.touching, exact_masks(scene, nearest), rng, **degradation) for nearest, _ in drawings]
    rim = rim_width_px(masks)
    views = []
    visible = np.zeros(len(scene.means), bool)
    for camera, drawing, ids in zip(cameras, drawings, masks, strict=True):
        found = weights_of(len(scene.means), *drawing, mark_rim(ids, rim))
        views.append(ViewWeights(camera.name, found.total, found.rows, found.ids, found.weights))
        visible[drawing[0][drawing[0] >= 0]] = True
    return scene, visible, lift(views, np.ones(len(scene.means), bool), "sha")


def labels_of(bolls: list[BollInstance], n: int) -> np.ndarray:
    labels = np.zeros(n, int)
    for boll in bolls:
        assert (labels[boll.indices] == 0).all(), "a Gaussian is in two bolls"
        labels[boll.indices] = boll.boll_id
    return labels


def test_bolls_are_found_in_spite_of_missed_merged_and_split_masks():
    scores, errors = [], []
    for seed in range(4):
        scene, visible, masks = lifted(seed)
        bolls = merge_views(masks, scene.means, UP)
        scores.append(f1_at_half(scene, labels_of(bolls, len(scene.means)), visible))
        errors.append(abs(len(bolls) - 24))
    assert np.mean(scores) >= 0.95, scores
    assert np.mean(errors) <= 1, errors


def test_exact_masks_give_exact_bolls():
    scene, visible, masks = lifted(1, missed=0, merged=0, split=0)
    bolls = merge_views(masks, scene.means, UP)
    assert len(bolls) == 24
    assert f1_at_half(scene, labels_of(bolls, len(scene.means)), visible) == 1.0
    pairs = match_bolls(np.array([boll.centre for boll in bolls]), scene.centres, 1.0)
    assert len(pairs) == 24
    heights = [boll.centre[2] for boll in bolls]
    assert heights == sorted(heights, reverse=True)
    assert [boll.boll_id for boll in bolls] == list(range(1, 25))
    assert all(3.0 < boll.diameter_su < 6.5 for boll in bolls)
    assert all(boll.confidence > 0.8 and len(boll.views) >= 5 for boll in bolls)


def test_a_pair_that_every_view_merges_is_parted_by_its_shape():
    scene, _, _ = drawn(1)
    pair = scene.touching[-1]
    _, visible, masks = lifted(1, missed=0.1, merged=0, split=0, always_merged=(pair,))
    bolls = merge_views(masks, scene.means, UP)
    labels = labels_of(bolls, len(scene.means))
    owners = [np.bincount(labels[(scene.bolls == boll) & visible]).argmax() for boll in pair]
    assert 0 not in owners and owners[0] != owners[1]
    assert all("parted_by_shape" in bolls[owner - 1].flags for owner in owners)


def test_a_boll_that_every_view_parts_is_one():
    scene, cameras, drawings = drawn(1)
    boll = 5
    halves = np.where((scene.bolls == boll) & (scene.means[:, 0] > scene.centres[boll - 1, 0]), 25, scene.bolls)
    masks = [exact_masks(replace(scene, bolls=halves), nearest) for nearest, _ in drawings]
    views = [
        ViewWeights(camera.name, found.total, found.rows, found.ids, found.weights)
        for camera, drawing, ids in zip(cameras, drawings, masks, strict=True)
        for found in [weights_of(len(scene.means), *drawing, mark_rim(ids, rim_width_px(masks)))]
    ]
    bolls = merge_views(lift(views, np.ones(len(scene.means), bool), "sha"), scene.means, UP)
    labels = labels_of(bolls, len(scene.means))
    assert len(bolls) == 24
    owners = np.bincount(labels[(scene.bolls == boll) & (labels > 0)])
    assert owners.max() > 0.95 * owners.sum() and "joined_by_shape" in bolls[owners.argmax() - 1].flags
    assert sum("joined_by_shape" in found.flags for found in bolls) == 1


def test_bolls_nearer_than_bolls_usually_are_are_flagged():
    def at(x: float, diameter_su: float = 1.0) -> BollInstance:
        return BollInstance(0, np.arange(3), ("a", "b"), np.array([x, 0, 0]), diameter_su, 1.0, ("few_views",))

    flagged = flag_close([at(0), at(0.8), at(1.7), at(5, 1.2), at(9, 0.8)])
    assert [boll.flags for boll in flagged] == [("few_views", "close")] * 2 + [("few_views",)] * 3
    assert flag_close([at(0)])[0].flags == ("few_views",)
    assert flag_close([]) == []


def test_names_of_masks_and_order_of_selections_are_of_no_consequence():
    scene, _, masks = lifted(2, 12)
    rng = np.random.default_rng(0)
    shuffled = [
        replace(masks.selections[k], mask_id=int(rng.integers(1, 60000)))
        for k in rng.permutation(len(masks.selections))
    ]
    expected = merge_views(masks, scene.means, UP)
    found = merge_views(replace(masks, selections=tuple(shuffled)), scene.means, UP)
    assert [b.indices.tolist() for b in found] == [b.indices.tolist() for b in expected]


@pytest.mark.parametrize("factor", [2.0**-12, 2.0**10])
def test_the_unit_of_length_is_of_no_consequence(factor):
    scene, _, masks = lifted(2, 12)
    expected = merge_views(masks, scene.means, UP)
    found = merge_views(masks, scene.means * np.float32(factor), UP)
    assert [b.indices.tolist() for b in found] == [b.indices.tolist() for b in expected]
    assert [b.diameter_su for b in found] == pytest.approx([b.diameter_su * factor for b in expected])


def test_no_masks_no_bolls():
    nothing = LiftedMasks(
        "", ("a.jpg",), np.zeros(0, np.int64), np.zeros(0, np.float32), np.zeros((1, 0), np.float32), ()
    )
    assert merge_views(nothing, np.zeros((5, 3), np.float32), UP) == []


def test_a_single_view_makes_no_boll():
    scene, _, masks = lifted(2, 12)
    only = masks.views[0]
    masks = replace(masks, selections=tuple(s for s in masks.selections if s.view == only))
    assert merge_views(masks, scene.means, UP) == []


def test_a_second_view_of_a_quarter_of_it_makes_no_boll():
    """What a clearly seen mask holds and a second view hardly sees has one witness; it was a boll of one view."""
    means = np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32)
    rows = np.arange(20)
    glimpse = np.where(rows < 5, 10.0, 0.5).astype(np.float32)
    full = np.full(20, 10, np.float32)
    ids = np.ones(20, np.uint16)
    witnesses = [
        ViewWeights("a.jpg", full, rows, ids, full),
        ViewWeights("b.jpg", glimpse, rows[:5], ids[:5], full[:5]),
    ]
    assert merge_views(lift(witnesses, np.ones(20, bool), "sha"), means, UP) == []
    witnesses[1] = ViewWeights("b.jpg", full, rows, ids, full)
    assert [boll.views for boll in merge_views(lift(witnesses, np.ones(20, bool), "sha"), means, UP)] == [
        ("a.jpg", "b.jpg")
    ]


def test_contraction_adds_up_evidence():
    # 0-1 and 1-2 attract, but 0-2 repel more: the weaker attraction loses.
    evidence = np.array([[0, 3, -5], [3, 0, 2], [-5, 2, 0]], np.float32)
    assert contract(evidence).tolist() == [0, 0, 1]
    assert contract(np.zeros((0, 0), np.float32)).tolist() == []
    assert contract(np.full((3, 3), -1, np.float32)).tolist() == [0, 1, 2]


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 14), st.integers(0, 2**32 - 1))
def test_contraction_equals_the_naive_loop_and_moves_never_lose(n, seed):
    rng = np.random.default_rng(seed)
    evidence = rng.normal(size=(n, n)).astype(np.float32)
    evidence = evidence + evidence.T
    groups = [[k] for k in range(n)]
    while len(groups) > 1:
        sums = {(i, j): evidence[np.ix_(groups[i], groups[j])].sum() for i in range(len(groups)) for j in range(i)}
        (i, j), strongest = max(sums.items(), key=lambda item: item[1])
        if strongest <= 0:
            break
        groups[j] += groups.pop(i)
    found = contract(evidence.copy())
    assert {frozenset(g) for g in groups} == {frozenset(np.flatnonzero(found == k)) for k in np.unique(found)}

    def kept(labels):
        return (evidence * (labels[:, None] == labels))[np.triu_indices(n, 1)].sum()

    assert kept(move_nodes(evidence.copy(), found)) >= kept(found) - 1e-3


def sphere(rng, n, radius, centre=(0, 0, 0)):
    directions = rng.normal(size=(n, 3))
    return np.array(centre) + radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_extent_is_the_middle_of_a_lopsided_ball():
    rng = np.random.default_rng(0)
    points = sphere(rng, 4000, 2.0, (5, 6, 7))
    points = points[(points[:, 0] > 5) | (rng.random(4000) < 0.3)]
    centre, widths = measure_extent(points)
    assert centre == pytest.approx([5, 6, 7], abs=0.15)
    assert widths == pytest.approx([4, 4, 4], rel=0.06)


def test_stragglers_and_crumbs_are_not_part_of_the_body():
    rng = np.random.default_rng(1)
    points = np.concatenate([sphere(rng, 300, 1.0), sphere(rng, 30, 0.2, (4, 0, 0)), [[9, 9, 9], [0, 0, 1.6]]])
    kept = find_compact_part(points)
    assert kept[:300].mean() > 0.98
    assert not kept[300:].any()


def test_only_touching_balls_are_parted():
    rng = np.random.default_rng(2)
    one, pair = sphere(rng, 300, 1.0), np.concatenate([sphere(rng, 300, 1.0), sphere(rng, 200, 0.8, (1.7, 0, 0))])
    assert split_heap(one, 2.0) is None
    assert split_heap(one * [1.4, 1, 1], 2.0) is None
    labels = split_heap(pair, 2.0)
    assert labels is not None
    assert len(np.unique(labels[:300])) == 1 or np.bincount(labels[:300]).max() > 285
    heap = np.concatenate([sphere(rng, 200, 1.0, c) for c in ([0, 0, 0], [2, 0, 0], [1, 1.73, 0])])
    labels = split_heap(heap, 2.0)
    assert labels is not None and labels.max() == 2


HEAPS = {
    "a row": [[0, 0, 0], [2, 0, 0], [4, 0, 0]],
    "a heap of four": [[0, 0, 0], [1.9, 0, 0], [0.95, 1.65, 0], [0.95, 0.55, 1.55]],
    "a bent row of five": [[0, 0, 0], [1.9, 0, 0], [3.2, 1.4, 0], [3.2, 3.3, 0.3], [1.5, 4.2, 0]],
    "a heap of six": [[1.4, 0, 0], [-1.4, 0, 0], [0, 1.4, 0], [0, -1.4, 0], [0, 0, 1.4], [0, 0, -1.4]],
}
"""Centres of touching balls of radius 1 or a little less."""


@pytest.mark.parametrize("centres", HEAPS.values(), ids=HEAPS.keys())
@pytest.mark.parametrize("seed", range(3))
def test_heaps_fall_into_as_many_pieces_as_they_have_balls(centres, seed):
    rng = np.random.default_rng(seed)
    radii = rng.uniform(0.85, 1.0, len(centres))
    balls = [sphere(rng, 120, radius, centre) for radius, centre in zip(radii, centres, strict=True)]
    owners = np.repeat(np.arange(len(centres)), 120)
    points = np.concatenate(balls) + rng.normal(0, 0.03, (len(owners), 3))
    # What lies inside of another ball does not show.
    inside = np.linalg.norm(points[:, None] - centres, axis=2) < 0.93 * radii
    inside[np.arange(len(owners)), owners] = False
    points, owners = points[~inside.any(axis=1)], owners[~inside.any(axis=1)]
    labels = split_heap(points, 1.9)
    assert labels is not None
    shares = np.zeros((len(centres), labels.max() + 1))
    np.add.at(shares, (owners, labels), 1)
    assert shares.shape[0] == shares.shape[1]
    assert sorted(shares.argmax(axis=1)) == list(range(len(centres)))
    assert (shares.max(axis=1) > 0.85 * shares.sum(axis=1)).all()


@pytest.mark.parametrize("widths", [(1.3, 1, 1), (1.6, 1.6, 1), (1.9, 1.9, 1.9)])
def test_a_large_ball_is_no_heap(widths):
    rng = np.random.default_rng(3)
    assert split_heap(sphere(rng, 400, 1.0) * widths + rng.normal(0, 0.03, (400, 3)), 2.0) is None


def test_a_crowd_that_every_view_merges_is_parted():
    crowd = [(a, b) for a in range(1, 6) for b in range(a + 1, 6)]
    scene, visible, masks = lifted(2, missed=0, merged=0, split=0, always_merged=tuple(crowd))
    bolls = merge_views(masks, scene.means, UP)
    labels = labels_of(bolls, len(scene.means))
    owners = [np.bincount(labels[(scene.bolls == boll) & visible]).argmax() for boll in range(1, 6)]
    assert 0 not in owners and len(set(owners)) == 5
    assert len(bolls) == 24


def test_bolls_are_matched_one_to_one():
    a = np.array([[0, 0, 0], [1, 0, 0], [50, 0, 0]])
    b = np.array([[0.9, 0, 0], [2.1, 0, 0], [np.nan, 0, 0]])
    assert match_bolls(a, b, 1.5).tolist() == [[0, 0], [1, 1]]
    assert match_bolls(a, b, 0.5).tolist() == [[1, 0]]
    assert match_bolls(np.zeros((0, 3)), b, 1.0).shape == (0, 2)


@pytest.mark.parametrize("apart, wanted", [(0.76, 1), (0.81, 2)])
def test_sets_too_near_to_be_two_bolls_are_one(apart, wanted):
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(2000, 3))
    ball *= rng.random((2000, 1)) ** (1 / 3) / np.linalg.norm(ball, axis=1, keepdims=True)
    centre, axes = measure_extent(ball)
    points = np.concatenate([ball - centre, ball - centre + [apart * axes.mean(), 0, 0]])
    labels, flags = np.repeat([1, 2], 2000), {}
    join_halves(labels, flags, points)
    assert len(np.unique(labels)) == wanted
    assert flags == ({1: "joined_by_shape"} if wanted == 1 else {})
