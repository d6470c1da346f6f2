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
