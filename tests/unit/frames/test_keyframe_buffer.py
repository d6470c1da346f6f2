# SPDX-License-Identifier: Apache-2.0
"""Choosing frames while a film streams by: which are held, and which are chosen of these."""

from __future__ import annotations

import numpy as np

from cotton3dg.frames.keyframe_buffer import HeldFrames, select_keyframes


def test_lingering_does_not_double_views_and_hurrying_does_not_tear_the_orbit(tmp_path) -> None:
    """600 frames at one place, a slow part, a fast part: the frames chosen are at even steps of the way."""
    ways = np.concatenate([np.full(600, 0.1), np.linspace(0.1, 2, 300), np.linspace(2, 5, 60)])
    scores = np.random.default_rng(0).uniform(0.7, 1, len(ways))
    held = HeldFrames(80, 4, np.uint8, tmp_path)
    for number, (way, score) in enumerate(zip(ways, scores, strict=True)):
        held.offer(number, float(way), float(score), np.full(4, number % 251, np.uint8))
    rows = np.array(held.frames)
    assert 50 <= len(rows) <= 80
    assert all((held.numbers_of(number) == number % 251).all() for number in rows)
    chosen = rows[select_keyframes(ways[rows], scores[rows], 40)]
    steps = np.diff(ways[chosen])
    assert len(chosen) == 40
    assert (ways[chosen] == 0.1).sum() <= 2
    assert steps.max() < 2.2 * np.median(steps)


def test_every_frame_is_held_while_there_is_room(tmp_path) -> None:
    held = HeldFrames(50, 1, np.uint8, tmp_path)
    for number in range(50):
        held.offer(number, 0.0, 1.0, np.zeros(1, np.uint8))
    assert held.frames == list(range(50))


def test_the_best_frame_of_an_interval_is_held(tmp_path) -> None:
    held = HeldFrames(10, 1, np.uint8, tmp_path)
    for number in range(200):
        held.offer(number, number / 10, float(number % 4 == 2), np.zeros(1, np.uint8))
    assert len(held.frames) >= 5
    assert all(number % 4 == 2 for number in held.frames)


def test_thinning_prefers_the_sharp() -> None:
    scores = np.where(np.arange(100) % 4 == 2, 1.0, 0.1)
    kept = np.array(select_keyframes(np.arange(100.0), scores, 25))
    assert len(kept) == 25
    assert (kept % 4 == 2).sum() >= 23
    assert select_keyframes(np.arange(5.0), np.ones(5), 9) == [0, 1, 2, 3, 4]
    assert select_keyframes(np.arange(5.0), np.ones(5), 3) == [0, 2, 4]
