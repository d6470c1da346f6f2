# SPDX-License-Identifier: Apache-2.0
"""Pictures of sunlit ground: the same for the same number, in hard light, of many brightnesses and sharpnesses."""

from __future__ import annotations

import numpy as np
import pytest

from cotton3dg.core.srgb import to_linear
from cotton3dg.simulate import backgrounds
from cotton3dg.simulate.grounds import GROUND_PX, _Relief, _sunlit, paint_ground


@pytest.fixture(scope="module")
def pictures() -> np.ndarray:
    return np.stack([paint_ground(np.random.default_rng(seed)) for seed in range(30)])


def test_a_number_is_a_picture(pictures: np.ndarray) -> None:
    assert pictures.shape == (30, GROUND_PX, GROUND_PX, 3)
    assert pictures.dtype == np.float32
    assert (pictures >= 0).all() and (pictures <= 1).all()
    np.testing.assert_array_equal(paint_ground(np.random.default_rng(4)), pictures[4])


def test_grounds_differ_in_brightness_and_sharpness_and_are_hardly_coloured(pictures: np.ndarray) -> None:
    middle = np.median(pictures, axis=(1, 2, 3))
    assert (middle > 0.8).sum() >= 3  # as white as lint
    assert (middle < 0.7).sum() >= 3
    sharpness = np.abs(np.diff(pictures, axis=2)).mean(axis=(1, 2, 3))
    assert sharpness.max() > 5 * sharpness.min()
    light = to_linear(pictures[:, ::4, ::4])
    assert (np.ptp(light, axis=-1) < 0.6).mean() > 0.95


def test_a_wall_throws_a_shadow_away_from_the_sun() -> None:
    height = np.zeros((GROUND_PX, GROUND_PX), np.float32)
    height[:, 200:220] = 30.0
    relief = _Relief(height, np.full((*height.shape, 3), 0.5, np.float32))
    from_right, from_left = (_sunlit(relief, azimuth, 0.6, 0.2).mean(axis=(0, 2)) for azimuth in (0.0, np.pi))
    np.testing.assert_allclose(from_right, np.roll(from_left[::-1], -28), rtol=0.01)
    assert from_right[224:232].min() > 2 * from_right[180:196].max()
    # 30 high, and 30 / tan(0.6) = 44 long.
    assert from_right[200 - 40] < 0.5 * from_right[200 - 48]


def test_backgrounds_have_grounds_among_them(monkeypatch: pytest.MonkeyPatch) -> None:
    size = backgrounds.BACKGROUND_PX
    monkeypatch.setattr(backgrounds, "_room_views", lambda seed, rng: [np.zeros((size, size, 3), np.uint8)])
    monkeypatch.setattr(backgrounds, "paint_ground", lambda rng: np.full((size, size, 3), 0.2))
    painted = backgrounds.paint_backgrounds(1)
    assert painted.shape[1:] == (size, size, 3) and painted.dtype == np.uint8
    assert (painted == 51).all(axis=(1, 2, 3)).sum() == backgrounds.GROUNDS
