# SPDX-License-Identifier: Apache-2.0
"""Bolls of all kinds: where they stand, how their locks lie."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import KDTree

from cotton3dg.simulate.mesh import SolidNoise, icosphere
from cotton3dg.simulate.organs import Site
from cotton3dg.simulate.varied_bolls import draw_kind, grow_boll


@pytest.mark.parametrize("seed", range(12))
def test_bolls_of_every_kind_stand_at_their_sites(seed):
    rng = np.random.default_rng(seed)
    site = Site(np.array([0, 0, 0.5]), np.array([0.03, 0, 0.52]), np.array([1.0, 0, 0]), 0.045)
    kind = draw_kind(rng)
    boll = grow_boll(rng, SolidNoise(rng), site, kind)
    assert np.isfinite(boll.lint.vertices).all() and np.isfinite(boll.bur.vertices).all()
    assert (boll.lint.colours >= 0).all() and (boll.lint.colours <= 1).all()
    near = np.linalg.norm(boll.lint.vertices - site.centre, axis=1)
    assert np.median(near) < (0.6 + 1.2 * kind.droop + kind.hang) * site.diameter
    assert near.min() < 0.5 * site.diameter


def locks_of(name: str, seed: int) -> list[np.ndarray]:
    """(V, 3) vertices of each lock of a boll of a kind whose diameter is 1."""
    rng = np.random.default_rng(seed)
    site = Site(np.zeros(3), np.array([0, 0, 0.6]), np.array([0.6, 0, 0.8]), 1.0)
    lint = grow_boll(rng, SolidNoise(rng), site, draw_kind(rng, name)).lint
    return list(lint.vertices.reshape(-1, len(icosphere(4)[0]), 3))


def test_separate_locks_are_apart_in_most_bolls_and_others_touch():
    far = {}
    for name in ("separate", "usual"):
        bolls = [locks_of(name, seed) for seed in range(30)]
        assert {len(locks) for locks in bolls} <= {2, 3, 4, 5}
        gaps = [min(KDTree(one).query(other)[0].min() for one, other in combinations(locks, 2)) for locks in bolls]
        far[name] = np.mean(np.array(gaps) > 0.02)
    assert far["separate"] > 0.5
    assert far["usual"] < 0.05


def test_points_of_the_bur_stand_between_separate_locks():
    site = Site(np.zeros(3), np.array([0, 0, 0.5]), np.array([0, 0, 1.0]), 1.0)
    kind = replace(draw_kind(np.random.default_rng(3), "separate"), locks=4, loose=0.0, lean=0.2, openness=1.0)
    for apart in (True, False):
        rng = np.random.default_rng(1)
        boll = grow_boll(rng, SolidNoise(rng), site, replace(kind, apart=apart))
        points = boll.bur.vertices[np.linalg.norm(boll.bur.vertices[:, :2], axis=1) > 0.55]
        locks = boll.lint.vertices.reshape(-1, len(icosphere(4)[0]), 3).mean(axis=1)
        cosines = (points[:, None, :2] * locks[None, :, :2]).sum(axis=2)
        cosines /= np.linalg.norm(points[:, None, :2], axis=2) * np.linalg.norm(locks[None, :, :2], axis=2)
        off = np.degrees(np.arccos(cosines.clip(-1, 1).max(axis=1)))
        assert (np.median(off) > 30) == apart


def test_locks_that_hang_reach_farther_down_than_those_that_stand():
    site = Site(np.array([0, 0, 0.5]), np.array([0, 0, 0.52]), np.array([0, 0, 1.0]), 0.045)
    kind = replace(draw_kind(np.random.default_rng(0)), droop=0.0, length=0.7, locks=4)
    lowest = []
    for hang in (0.0, 1.0):
        rng = np.random.default_rng(1)
        lowest.append(grow_boll(rng, SolidNoise(rng), site, replace(kind, hang=hang)).lint.vertices[:, 2].min())
    assert lowest[1] < lowest[0] - 0.3 * site.diameter
