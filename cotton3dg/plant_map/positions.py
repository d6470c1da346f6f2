# SPDX-License-Identifier: Apache-2.0
"""Fruiting positions: the site of its branch at which a boll sits, where empty sites are scars of millimetres.

A fruiting branch is a sympodium: at every node it bears a flower and turns to the other side, and its internodes
shorten outwards. So a good row of nodes has one node at every boll, bends at nodes and not between them, and internodes
of likely lengths. Dynamic programming weighs all rows of nodes; the share of each position among them is its
probability.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64
from ..geometry.polylines import length_of, resampled

STEP_CM: Final = 0.5
APART_CM: Final = 2.0
"""Least distance of two nodes."""
EMPTY: Final = 0.45
"""Probability that a site has lost its boll while one farther out has kept its own."""
MOST_EVIDENCE: Final = 3.0
LAST: Final = 3
"""Last position; all farther ones count as this."""
MOST_NODES: Final = 6
STALK_CM: Final = (2.5, 1.0)
"""Mean and standard deviation of the straight distance from a node to the foot of its boll."""
SEEN_CM: Final = 2.5
"""Standard deviation, along the branch, of the place where a stalk seems to leave it. The stalk may lie beside the
branch for a while, or the boll may touch another place of it."""
BEYOND_CM: Final = 1.0
"""Largest distance by which a node is farther out than the foot of its boll."""
WINDOW_CM: Final = 1.8
"""Length of the chords on either side of a place between which its bend is measured."""
BEND_DEG: Final = (24.0, 11.0)
"""Mean and standard deviation of the bend at a node, ..."""
STRAIGHT_DEG: Final = 8.0
"""... and root mean square of that between nodes."""
FIRST_CM: Final = (8.0, 0.55)
"""First internode of the lowest fruiting branch, and the share by which the one at the stem's tip is shorter. With the
spreads below these are a broad guess at upland cotton, and not fitted to any plants."""
FIRST_SPREAD: Final = 0.35
SHRINKS: Final = 0.7
"""Ratio of an internode to the one before it."""
SHRINKS_SPREAD: Final = 0.3
"""Both spreads are of the logarithm."""


@dataclass(frozen=True)
class Sited:
    """Where a boll's node lies on its branch."""

    path_cm: float
    position: int
    """1, 2, ... `LAST`, which includes those beyond; 0 = not inferred."""
    confidence: float


def infer_positions(curve: Float64, nodes_cm: list[float], feet: Float64, up: float, fruiting: bool) -> list[Sited]:
    """Position of each of a branch's bolls.

    Args:
        curve: (N, 3) cm, from the stem's centre line.
        nodes_cm: path length at which each boll's stalk seems to leave it, ascending. feet: (B, 3) of these bolls.
        up: height of the branch's foot, 0 at the lowest branch, 1 at the stem's tip.
    """
    if not fruiting or not nodes_cm or length_of(curve) < 2 * STEP_CM:
        return [Sited(node, 0, np.nan) for node in nodes_cm]
    bends = bends_deg(curve)
    steps = _steps_of_nodes(bends, resampled(curve, STEP_CM), nodes_cm, feet)
    evidence = _empty_evidence(bends, steps)
    first = FIRST_CM[0] * (1 - FIRST_CM[1] * up)
    shares = [_shares(_position_weights(evidence, steps[: number + 1], first)) for number in range(len(steps))]
    chosen = _outwards(shares)
    return [
        Sited(node, position, float(own[position - 1]))
        for node, position, own in zip(nodes_cm, chosen, shares, strict=True)
    ]


def _steps_of_nodes(bends: Float64, line: Float64, nodes_cm: list[float], feet: Float64) -> list[int]:
    """The likeliest row of the bolls' nodes: at bends, a stalk's length from the boll, `APART_CM` from each other.

    Args:
        line: (K, 3) the branch, `STEP_CM` apart.
    """
    stations, gain = np.arange(len(bends)) * STEP_CM, _bend_gain(bends)
    apart = round(APART_CM / STEP_CM)
    reached: list[Float64] = []
    for node, foot in zip(nodes_cm, feet, strict=True):
        away = np.linalg.norm(line - foot, axis=1)
        own = gain - 0.5 * ((away - STALK_CM[0]) / STALK_CM[1]) ** 2 - 0.5 * ((stations - node) / SEEN_CM) ** 2
        own[stations > stations[np.argmin(away)] + BEYOND_CM] = own[0] = -np.inf
        if reached:
            own[:apart] = -np.inf
            own[apart:] += np.maximum.accumulate(reached[-1])[:-apart]
        reached.append(own)
    if not np.isfinite(reached[-1]).any():
        return [int(np.clip(round(node / STEP_CM), 1, len(bends) - 1)) for node in nodes_cm]
    steps = [int(np.argmax(reached[-1]))]
    for before in reversed(reached[:-1]):
        steps.insert(0, int(np.argmax(before[: steps[0] - apart + 1])))
    return steps


def bends_deg(curve: Float64) -> Float64:
    """(K,) angle between the chords before and after each place, `STEP_CM` apart; 0 where a chord leaves the curve."""
    line = resampled(curve, STEP_CM)
    n = max(1, round(WINDOW_CM / STEP_CM))
    bends = np.zeros(len(line))
    if len(line) > 2 * n:
        before, after = line[n:-n] - line[: -2 * n], line[2 * n :] - line[n:-n]
        cosines = (before * after).sum(axis=1) / (np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1))
        bends[n:-n] = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return bends


def sharpest(bends: Float64) -> NDArray[np.bool_]:
    """(K,) which places bend at least as much as all others within `APART_CM`."""
    n = round(APART_CM / STEP_CM)
    return np.array([bends[i] >= bends[max(0, i - n) : i + n + 1].max() for i in range(len(bends))], bool)


def _bend_gain(bends: Float64) -> Float64:
    """(K,) logarithm of how much likelier a bend is at a node than between nodes; 0 where chords are too short."""
    mean, spread = BEND_DEG
    node = -0.5 * (np.minimum(bends - mean, 0) / spread) ** 2 - np.log(spread)
    none = -0.5 * (bends / STRAIGHT_DEG) ** 2 - np.log(STRAIGHT_DEG) + np.log(2)
    return np.where(bends == 0, 0.0, np.clip(node - none, -MOST_EVIDENCE, MOST_EVIDENCE))


def _empty_evidence(bends: Float64, bolls: list[int]) -> Float64:
    """(K,) logarithm of the odds that a place is an empty node.

    Only the sharpest place within `APART_CM` is evidence for a node; the bend at a boll's own node only counts for
    that node.

    Args:
        bolls: steps of the bolls' nodes.
    """
    evidence = _bend_gain(bends)
    evidence[~sharpest(bends) & (bends > 0)] = -MOST_EVIDENCE
    n = round(APART_CM / STEP_CM)
    for boll in bolls:
        evidence[max(0, boll - n) : boll + n + 1] = -MOST_EVIDENCE
    of_empty: Float64 = evidence + np.log(EMPTY)
    return of_empty


def _position_weights(evidence: Float64, bolls: list[int], first_cm: float) -> Float64:
    """(MOST_NODES,) logarithm of the weight of the last of `bolls` being at position 1, 2, ...

    Args:
        bolls: steps of the nodes that are known, ascending; those before the last one take part in every row.
    """
    last = bolls[-1]
    if last < 1:
        return np.append(0.0, np.full(MOST_NODES - 1, -np.inf))
    known = np.zeros(last + 1, bool)
    known[bolls[:-1]] = True
    lengths = np.arange(last + 1) * STEP_CM
    logs = np.log(np.maximum(lengths, 1e-9))
    weights = np.full(MOST_NODES, -np.inf)
    # state[a, b]: the last two nodes; rows of nodes may not step over a known one.
    passed = np.concatenate([[0], np.cumsum(known)])
    state = np.full((last + 1, last + 1), -np.inf)
    # Densities over lengths whose logarithms are normally distributed.
    prior = -0.5 * ((logs - np.log(first_cm)) / FIRST_SPREAD) ** 2 - np.log(FIRST_SPREAD) - logs
    for b in range(1, last + 1):
        if passed[b] == 0:
            state[0, b] = prior[b] + (evidence[b] + np.log(STEP_CM) if not known[b] and b != last else 0.0)
    weights[0] = state[0, last]
    steps = []
    for b in range(1, last):
        stop = next((c for c in range(b + 1, last + 1) if known[c]), last)
        c = np.arange(b + 1, stop + 1)
        ratio = logs[c - b][None, :] - logs[b - np.arange(b)][:, None]
        step = -0.5 * ((ratio - np.log(SHRINKS)) / SHRINKS_SPREAD) ** 2 - np.log(SHRINKS_SPREAD)
        free = ~known[c] & (c != last)
        steps.append((b, c, step + np.where(free, evidence[c] + np.log(STEP_CM), 0.0) - logs[c - b]))
    for count in range(1, MOST_NODES):
        following = np.full_like(state, -np.inf)
        for b, c, step in steps:
            likely = np.flatnonzero(np.isfinite(state[:b, b]))
            if len(likely):
                following[b, c] = _log_of_sum(state[likely, b][:, None] + step[likely])
        state = following
        column = state[:, last]
        if np.isfinite(column).any():
            weights[count] = np.logaddexp.reduce(column)
    return weights


def _log_of_sum(logs: Float64) -> Float64:
    """(C,) logarithm of the sum of each column's exponentials (R, C), all finite."""
    top = logs.max(axis=0)
    of_sum: Float64 = top + np.log(np.exp(logs - top).sum(axis=0))
    return of_sum


def _shares(weights: Float64) -> Float64:
    """(LAST,) probability of each position; equal ones without any evidence."""
    if not np.isfinite(weights).any():
        return np.full(LAST, 1 / LAST)
    shares = np.exp(weights - weights.max())
    shares /= shares.sum()
    return np.append(shares[: LAST - 1], shares[LAST - 1 :].sum())


def _outwards(shares: list[Float64]) -> list[int]:
    """The likeliest positions that grow outwards; only the last one, which stands for many, may repeat."""
    best: dict[int, tuple[float, list[int]]] = {0: (0.0, [])}
    for own in shares:
        following: dict[int, tuple[float, list[int]]] = {}
        for before, (score, row) in best.items():
            for position in range(min(before + 1, LAST), LAST + 1):
                reached = score + float(np.log(max(own[position - 1], 1e-12)))
                if position not in following or reached > following[position][0]:
                    following[position] = reached, [*row, position]
        best = following
    return max(best.values(), key=lambda item: item[0])[1]
