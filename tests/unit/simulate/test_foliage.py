# SPDX-License-Identifier: Apache-2.0
"""Bracts around bolls and without them, and wisps of lint."""

import numpy as np
import pytest

from cotton3dg.simulate.foliage import bracted_boll, empty_bracts, lint_wisps
from cotton3dg.simulate.mesh import SolidNoise, icosphere
from cotton3dg.simulate.rays import build_rays


@pytest.mark.parametrize("seed", range(6))
def test_a_closed_boll_is_wrapped_in_its_bracts_from_its_foot(seed):
    rng = np.random.default_rng(seed)
    whole = bracted_boll(rng, SolidNoise(rng), 0.045)
    boll = whole.vertices[: len(icosphere(3)[0])].astype(np.float32)
    bracts = whole.triangles[(whole.triangles >= len(boll)).all(axis=1)]
    away = boll * (1, 1, 0) / np.maximum(np.linalg.norm(boll[:, :2], axis=1, keepdims=True), 1e-9)
    hidden = build_rays([(whole.vertices, bracts)]).blocked(boll, away.astype(np.float32))
    assert hidden[boll[:, 2] < 0.5 * boll[:, 2].max()].mean() > 0.95
    assert np.ptp(whole.vertices[:, 2]) > 1.02 * np.ptp(boll[:, 2])


@pytest.mark.parametrize("seed", range(6))
def test_empty_bracts_are_bent_back_farther_than_those_around_a_boll(seed):
    """Seen from above, their teeth stand out beyond all else, and they hide nothing."""
    rng = np.random.default_rng(seed)
    empty = empty_bracts(rng, SolidNoise(rng), 0.045).vertices
    away = np.linalg.norm(empty[:, :2], axis=1)
    closed = bracted_boll(rng, SolidNoise(rng), 0.045).vertices
    assert away.max() > 0.5 * np.ptp(empty[:, 2])
    assert away.max() / np.ptp(empty[:, 2]) > np.linalg.norm(closed[:, :2], axis=1).max() / np.ptp(closed[:, 2])


@pytest.mark.parametrize("seed", range(6))
def test_wisps_of_lint_are_thin_and_white(seed):
    rng = np.random.default_rng(seed)
    wisps = lint_wisps(rng, SolidNoise(rng))
    _, inertia, _ = np.linalg.svd(wisps.vertices[:8] - wisps.vertices[:8].mean(axis=0))
    assert inertia[0] < 0.006
    assert np.linalg.norm(wisps.vertices, axis=1).max() < 0.3
    assert np.ptp(wisps.colours, axis=1).max() < 0.12 and wisps.colours.min() > 0.5
