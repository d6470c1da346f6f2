# SPDX-License-Identifier: Apache-2.0
"""Photos of the page that can be pointed at."""

import numpy as np
import pytest

from cotton3dg.report import pointing


def test_photos_take_the_best_quality_that_the_page_has_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    photos = [np.random.default_rng(n).integers(0, 255, (120, 160, 3), np.uint8) for n in range(3)]
    best = sum(map(len, pointing._encode(photos)))
    monkeypatch.setattr(pointing, "MOST_CHARACTERS", int(0.9 * best))
    fitted = pointing._encode(photos)
    assert 0.5 * best < sum(map(len, fitted)) <= 0.9 * best
    monkeypatch.setattr(pointing, "MOST_CHARACTERS", 1)
    assert len(pointing._encode(photos)) == 3


def test_photos_that_no_quality_makes_small_enough_become_smaller(monkeypatch: pytest.MonkeyPatch) -> None:
    """As 12 photos of a plant in leaf: at the lowest quality they took 1.5 MB."""
    noisy = [np.random.default_rng(7).integers(0, 255, (720, 1280, 3), np.uint8)]
    sizes = []
    for most in (1, 1_200_000):
        monkeypatch.setattr(pointing, "MOST_CHARACTERS", most)
        sizes.append(len(pointing._encode(noisy)[0]))
    smallest, finest = sizes
    assert smallest < 0.3 * finest
    monkeypatch.setattr(pointing, "MOST_CHARACTERS", int(1.2 * smallest))
    assert len(pointing._encode(noisy)[0]) <= 1.2 * smallest
