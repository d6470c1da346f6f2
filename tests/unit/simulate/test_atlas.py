# SPDX-License-Identifier: Apache-2.0
"""Textures of a room in one image."""

import numpy as np

from cotton3dg.simulate.atlas import pack


def test_atlas_filters_and_keeps_textures_apart():
    ramp = np.linspace(0, 1, 64, dtype=np.float32)[None, :, None] * np.ones((32, 1, 3), np.float32)
    checks = np.indices((64, 64)).sum(axis=0)[..., None] % 2 * np.ones(3, np.float32)
    atlas = pack([ramp, checks.astype(np.float32), np.full((8, 200, 3), 0.25, np.float32)])
    s = np.random.default_rng(0).uniform(0, 1, 500).astype(np.float32)
    levels = np.linspace(0, 9, 500, dtype=np.float32)
    flat = atlas.sample(np.full(500, 2), s, s[::-1].copy(), levels)
    np.testing.assert_allclose(flat, 0.25, atol=1e-3)
    coarse = atlas.sample(np.full(500, 1), s, s[::-1].copy(), np.full(500, 1.0, np.float32))
    np.testing.assert_allclose(coarse, 0.5, atol=1e-3)
    fine = atlas.sample(np.zeros(500, int), s, s, np.zeros(500, np.float32))
    np.testing.assert_allclose(fine[:, 0], ((64 * s - 0.5) / 63).clip(0, 1), atol=0.002)
