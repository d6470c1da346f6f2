# SPDX-License-Identifier: Apache-2.0
"""How many frames of a film are looked at."""

from __future__ import annotations

from cotton3dg.frames.take_video import _looked_at_every


def test_long_and_fast_films_are_looked_at_more_sparsely() -> None:
    assert _looked_at_every(30.0, 799, 100) == 1
    assert _looked_at_every(30.0, 900, 100) == 2
    assert _looked_at_every(60.0, 1600, 100) == 4
    assert _looked_at_every(60.0, 2400, 100) == 5  # 12 a second
    assert _looked_at_every(30.0, 10**6, 100) == 2  # a header may claim anything
    assert _looked_at_every(float("nan"), 0, 100) == 1
