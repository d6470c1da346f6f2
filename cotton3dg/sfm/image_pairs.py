# SPDX-License-Identifier: Apache-2.0
"""Which images of a walk around a plant to match with each other."""

from __future__ import annotations

from typing import Final

MOST_IN_ALL_PAIRS: Final = 300
"""Largest number of images that are matched in all pairs: 45,000 pairs, each quickly compared in a minute or two."""


def choose_pairs(n: int, overlap: int, ordered: bool) -> list[tuple[int, int]]:
    """Pairs of images to match.

    Images in order of time are matched with the next `overlap` / 2 and then with ever farther ones, each distance about
    1.4 times the one before, for as many again: near ones give many matches, far ones stiffness. The order is
    taken as a ring, so that a full turn closes without a search for loops. Every `overlap`-th image is matched with
    every other such one, which ties a second turn, or a walk back, to the first. For unordered images all pairs are
    returned, and `matching.find_similar_pairs` takes the good ones; very many images are paired as if ordered and
    twice as dense.

    Returns:
        Ascending (i, j) with i < j, each once.
    """
    if not ordered and n <= MOST_IN_ALL_PAIRS:
        return [(i, j) for i in range(n) for j in range(i + 1, n)]
    if not ordered:
        overlap *= 2
    near = max(1, (overlap + 1) // 2)
    offsets = list(range(1, near + 1))
    while len(offsets) < overlap:
        offsets.append(max(offsets[-1] + 1, round(offsets[-1] * 1.4)))
    ring = {(i, (i + d) % n) for d in offsets for i in range(n)}
    ties = {(i, j) for i in range(0, n, overlap) for j in range(i, n, overlap)}
    return sorted({(min(i, j), max(i, j)) for i, j in ring | ties if i != j})
