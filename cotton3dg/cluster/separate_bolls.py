# SPDX-License-Identifier: Apache-2.0
"""Separates the bolls of a plant: finds parts where the votes of all views meet, and joins those of one boll.

The votes for a boll that lies deep in another make no peak of their own, only a slope of the other's peak. A second
search therefore takes only the votes that no middle explains. It also finds locks of large bolls; afterwards a fitted
score decides which parts are one boll (`same_boll`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32, Float64
from ..geometry.point_sets import weighted_median
from .boll_parts import Part, gather_parts
from .hough_voting import APART, FARTHEST, Middles, Votes, find_faint, find_middles
from .join_parts import join_parts
from .lint_in_space import LintInSpace
from .same_boll import USUAL_JOINING, Score, read_score
from .split_parts import split_parts

EXPLAINED: Final = 0.15
"""A middle explains the rays that pass it within this distance, in diameters. With three times this distance it would
explain most votes for a neighbouring boll."""
USUAL_CM: Final = 4.0
"""Usual median diameter of bolls by the votes. It gives a length to a scene without a scale."""


@dataclass(frozen=True)
class Bolls(Middles):
    """Bolls, those with the most votes first."""

    one_boll: Float32
    """(B,) probability that each is one boll: neither several bolls nor a part of one."""


class Separated(NamedTuple):
    """The bolls that the votes separate."""

    bolls: Bolls
    faint: Bolls
    """Candidates that hardly look like lint."""
    joining: float
    """Share of the parts that were joined to others."""


def separate_bolls(votes: Sequence[Votes], lint: LintInSpace, up: Float64, cm_per_su: float | None = None) -> Separated:
    """The bolls of a plant.

    Args:
        votes: of each view.
        up: (3,) upwards in the scene.
        cm_per_su: None = unknown; then the median boll has the size `USUAL_CM`.
    """
    score = read_score()
    parts = gather_parts(find_parts(votes, score.split_gain), votes, lint)
    bolls = join_bolls(parts, up, cm_per_su or guess_scale(votes), score)
    faint = find_faint(bolls, votes)
    return Separated(bolls.take(~faint), bolls.take(faint), joined_share(len(bolls.centres), len(parts)))


def join_bolls(parts: Mapping[int, Part], up: Float64, cm_per_su: float, score: Score) -> Bolls:
    """Join parts that are one boll by the score, which first learns how many of the plant's parts join at all."""
    score = score.of_plant(find_joining(parts, up, cm_per_su, score))
    joined = join_parts(parts, up, cm_per_su, score.probability)
    rows = sorted(joined.parts, key=lambda row: -joined.parts[row].support)
    found = [joined.parts[row] for row in rows]
    return Bolls(
        centres=np.array([part.centre for part in found], np.float32).reshape(-1, 3),
        diameters=np.array([part.diameter for part in found], np.float32),
        support=np.array([part.support for part in found], np.float32),
        views=np.array([part.views for part in found], np.int64),
        one_boll=np.array([score.one_boll.probability(joined.one_boll(row)) for row in rows], np.float32),
    )


def find_joining(parts: Mapping[int, Part], up: Float64, cm_per_su: float, score: Score) -> float:
    """Share of the parts that join others, by the score for a usual plant."""
    usual = score.of_plant(USUAL_JOINING)
    return joined_share(len(join_parts(parts, up, cm_per_su, usual.probability).parts), len(parts))


def joined_share(bolls: int, parts: int) -> float:
    """Share of the parts that are joined to others."""
    return 1 - bolls / parts if parts else 0.0


def guess_scale(votes: Sequence[Votes]) -> float:
    """Centimetres of a scene unit if bolls are of usual size."""
    diameters, weights = (np.concatenate([getattr(view, name) for view in votes]) for name in ("diameters", "weights"))
    return USUAL_CM / weighted_median(diameters, weights) if len(diameters) else 1.0


def find_parts(votes: Sequence[Votes], split_gain: float) -> Middles:
    """The middles of bolls or parts of bolls, split where two middles explain the votes much better."""
    return split_parts(find_peaks(votes), votes, split_gain)


def find_peaks(votes: Sequence[Votes]) -> Middles:
    """The middles where votes meet; then those where the votes meet that none of the first explains."""
    middles = find_middles(votes)
    others = find_middles([view.take(~find_explained(view, middles)) for view in votes])
    away = np.linalg.norm(others.centres[:, None] - middles.centres, axis=2)
    hidden = (away > APART * 0.5 * (others.diameters[:, None] + middles.diameters)).all(axis=1)
    return middles.merged_with(others.take(hidden))


def find_explained(view: Votes, middles: Middles) -> NDArray[np.bool_]:
    """(N,) which rays pass near the middle of a boll that their lint may belong to."""
    explained = np.zeros(len(view.rays), bool)
    for centre, diameter in zip(middles.centres, middles.diameters, strict=True):
        near = np.flatnonzero(np.linalg.norm(view.surfaces - centre, axis=1) < FARTHEST * diameter)
        to, rays = centre - view.eye, view.rays[near]
        explained[near] |= np.linalg.norm(to - (rays @ to)[:, None] * rays, axis=1) < EXPLAINED * diameter
    return explained
