# SPDX-License-Identifier: Apache-2.0
"""Bolls of one image from what the network says of its pixels."""

import numpy as np
import pytest

from cotton3dg.core.network_maps import Maps
from cotton3dg.masks.group_votes import group_votes

SHAPE = (100, 140)


def maps_of(bolls: list[tuple[float, float, float]], noise_px: float = 0.0, hidden: tuple[slice, slice] | None = None):
    """What a network should say of discs (x, y, diameter; px of the maps), the first in front."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    true = np.zeros(SHAPE, int)
    votes, diameters = np.zeros((2, *SHAPE)), np.full(SHAPE, 20.0)
    for number, (cx, cy, diameter) in reversed(list(enumerate(bolls, start=1))):
        inside = (x - cx) ** 2 + (y - cy) ** 2 < diameter**2 / 4
        true[inside] = number
        votes[0][inside], votes[1][inside], diameters[inside] = cx, cy, diameter
    if hidden is not None:
        true[hidden] = 0
    lint = np.where(true > 0, 0.95, 0.02)
    probabilities = np.zeros((5, *SHAPE), np.float32)
    probabilities[0], probabilities[1] = 1 - lint, lint
    votes = 2 * (votes + noise_px * rng.normal(size=votes.shape))
    size = (2 * SHAPE[0], 2 * SHAPE[1])
    maps = Maps(probabilities, votes.astype(np.float32), (2 * diameters).astype(np.float32), 2.0, size)
    return maps, true


def iou(found: np.ndarray, true: np.ndarray) -> float:
    return (found & true).sum() / (found | true).sum()


@pytest.mark.parametrize("noise_px", [0, 2])
def test_touching_bolls_are_told_apart_by_their_votes(noise_px):
    maps, true = maps_of([(40, 50, 30), (62, 50, 26), (100, 40, 14)], noise_px)
    ids, scores = group_votes(maps)
    assert ids.shape == (200, 280)
    assert sorted(scores) == sorted(np.unique(ids[ids > 0]).tolist())
    assert len(scores) == 3
    small = ids[::2, ::2]
    for boll in (1, 2, 3):
        best = max(iou(small == k, true == boll) for k in scores)
        assert best > 0.85
    assert min(scores.values()) > 0.88


def test_a_boll_behind_a_branch_is_one():
    maps, true = maps_of([(60, 50, 40)], hidden=(slice(None), slice(57, 63)))
    ids, scores = group_votes(maps)
    assert len(scores) == 1
    assert iou(ids[::2, ::2] > 0, true > 0) > 0.85


def test_specks_and_nothing_are_no_bolls():
    maps, _ = maps_of([(60, 50, 1.5)])
    maps.diameters[:] = 60
    assert group_votes(maps)[1] == {}
    ids, scores = group_votes(maps_of([])[0])
    assert not ids.any() and scores == {}


def test_votes_outside_of_the_image_still_make_a_boll_cut_by_its_edge():
    maps, true = maps_of([(-6, 50, 40)])
    ids, _ = group_votes(maps)
    assert iou(ids[::2, ::2] > 0, true > 0) > 0.8
