# SPDX-License-Identifier: Apache-2.0
"""Whether a camera walked around what it saw, or stood while the plant turned."""

from __future__ import annotations

import numpy as np
import pytest

from cotton3dg.errors import CaptureFailed
from cotton3dg.sfm import reconstruction
from cotton3dg.sfm.features import Features
from cotton3dg.sfm.matching import PairMatches
from cotton3dg.sfm.stationary_camera import pairs_far_apart, require_walk, standing_pct

IMAGES, POINTS, SIDE_PX = 40, 200, 640
PAIRS = [(i, j) for i in range(IMAGES) for j in range(i + 1, min(i + 9, IMAGES))]


def seen_from(azimuth_deg: float, points: np.ndarray) -> np.ndarray:
    """(N, 2) px of points in a camera that goes round the origin at a distance of 2."""
    a = np.radians(azimuth_deg)
    x, y = np.cos(a) * points[:, 0] + np.sin(a) * points[:, 1], np.cos(a) * points[:, 1] - np.sin(a) * points[:, 0]
    return SIDE_PX * np.stack([0.5 + 0.8 * x / (2 + y), 0.3 + 0.8 * points[:, 2] / (2 + y)], axis=1)


def film(turning: float, tremble_px: float = 0.0) -> dict[int, Features]:
    """Features of a scene that goes round for this share; the rest stands still before the camera."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.7, 0.7, (POINTS, 3)) * (1, 1, 0.4)
    turns = np.arange(POINTS) < turning * POINTS
    images = {}
    for number in range(IMAGES):
        places = np.where(turns[:, None], seen_from(number * 9, points), seen_from(0, points))
        places = places + tremble_px * rng.normal(size=2) + 0.3 * rng.normal(size=places.shape)
        images[number] = Features(places.astype(np.float32), np.zeros((POINTS, 128), np.uint8))
    return images


def matched(pairs: list[tuple[int, int]]) -> dict[tuple[int, int], PairMatches]:
    rows = np.repeat(np.arange(POINTS, dtype=np.uint32)[:, None], 2, axis=1)
    return {pair: PairMatches(np.eye(3), rows) for pair in pairs}


def test_a_walk_leaves_nothing_in_its_place() -> None:
    assert standing_pct(film(1.0), matched(pairs_far_apart(PAIRS, IMAGES))) < 20
    require_walk(film(1.0), matched(pairs_far_apart(PAIRS, IMAGES)))


@pytest.mark.parametrize("tremble_px", [0.0, 6.0])
def test_a_turntable_is_refused_in_a_hand_as_on_a_tripod(tremble_px: float) -> None:
    with pytest.raises(CaptureFailed, match="stands still, though the plant may turn"):
        require_walk(film(0.3, tremble_px), matched(pairs_far_apart(PAIRS, IMAGES)))


def test_a_turntable_before_a_bare_wall_is_a_walk() -> None:
    require_walk(film(0.8), matched(pairs_far_apart(PAIRS, IMAGES)))


def test_neighbours_say_nothing_and_no_pair_is_no_evidence() -> None:
    assert all(3 <= j - i <= IMAGES - 3 for i, j in pairs_far_apart([*PAIRS, (0, IMAGES - 1)], IMAGES))
    assert 12 <= len(pairs_far_apart(PAIRS, IMAGES)) < 24
    assert standing_pct({}, {}) is None
    require_walk({}, {})


def test_nothing_else_is_matched_of_a_turntable(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int]] = []
    monkeypatch.setattr(reconstruction, "match_pairs", lambda _, pairs: asked.extend(pairs) or matched(pairs))
    with pytest.raises(CaptureFailed):
        reconstruction._match(film(0.3), PAIRS, IMAGES)
    assert len(asked) < 24
    asked.clear()
    assert list(reconstruction._match(film(1.0), PAIRS, IMAGES)) == PAIRS
    assert sorted(asked) == PAIRS
