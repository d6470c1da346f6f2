# SPDX-License-Identifier: Apache-2.0
"""The bolls of a plant from the network's maps: votes meet in space, a score joins parts, Gaussians get labels.

Each Gaussian of lint gets its boll directly; masks of single images have no part in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import BollInstance, LeftOut
from ..core.machine import on_all_cores
from ..core.network_maps import Maps
from ..core.scene import Camera, Float32, Float64, Gaussians
from ..geometry.point_sets import measure_extent
from .boll_images import draw_bolls
from .boll_shape import number_bolls
from .hough_voting import Middles, Votes, cast_votes
from .label_gaussians import average_votes
from .lint_in_space import LintInSpace
from .separate_bolls import Bolls, Separated, separate_bolls
from .white_things import find_white_things, measure_surroundings

FAINT_IS_BOLL: Final = 0.25
"""Probability that something left out as faint is a boll. On twenty simulated plants four were left out: one boll, two
things and a part of a boll."""
THING_IS_BOLL: Final = 0.1
"""The same of a white thing. This is a guess: these plants had too few white things."""
FEWEST_TO_HALVE: Final = 12
"""Least number of views for counts by halves of them. With fewer views a half sees too little."""
FEW_VIEWS: Final = 3
"""A boll has a flag if fewer images than this show it."""


@dataclass(frozen=True)
class Located:
    """The bolls of a plant."""

    bolls: list[BollInstance]
    """From the top downwards, with ids 1, 2, ..."""
    images: dict[str, NDArray[np.uint16]] = field(default_factory=dict)
    """Image name -> (H, W) boll ids, 0 = none."""
    halves: tuple[int, int] | None = None
    """Counts of bolls by every second image, and by the others; None with too few images."""
    left_out: tuple[LeftOut, ...] = ()
    joining: float = 0.0
    """Share of the parts of bolls that were joined to others."""


def locate_bolls(
    maps: Sequence[Maps],
    cameras: Sequence[Camera],
    gaussians: Gaussians,
    shares: Float32,
    up: Float64,
    cm_per_su: float | None = None,
) -> Located:
    """The bolls that the maps of all images together show.

    Args:
        maps: of the image of each of `cameras`.
        shares: (N,) share of lint of each Gaussian, 0..1.
        up: (3,) roughly upwards in the scene.
        cm_per_su: length of a scene unit; None = unknown.
    """
    lint = LintInSpace.of(gaussians, shares)
    votes = on_all_cores(lambda number: cast_votes(maps[number], cameras[number], lint), range(len(maps)))
    (middles, faint, joining), *halves = separate_all(votes, lint, up, cm_per_su)
    owners = average_votes(votes, middles)
    images = on_all_cores(lambda camera: draw_bolls(camera, lint, owners), cameras)
    sums = np.zeros((len(middles.centres), 4))
    for view, ids in zip(maps, images, strict=True):
        sums += measure_surroundings(view, ids, len(middles.centres))
    white = find_white_things(sums, middles.support)
    owner = np.zeros(len(gaussians), np.uint16)
    owner[lint.rows] = owners.at(gaussians.means[lint.rows])
    bare = ~np.isin(np.arange(1, len(middles.centres) + 1), owner)
    by_name = {camera.name: ids for camera, ids in zip(cameras, images, strict=True)}
    bolls = number_bolls(list(_instances(owner, middles, ~white, gaussians, by_name)), up)
    numbers = np.zeros(len(middles.centres) + 1, np.uint16)
    for boll in bolls:
        numbers[owner[boll.indices[0]]] = boll.boll_id
    counts = [int((~np.isin(middles.nearest(half.bolls.centres), np.flatnonzero(white) + 1)).sum()) for half in halves]
    return Located(
        [replace(boll, masks=tuple((view, boll.boll_id) for view in boll.views)) for boll in bolls],
        {name: numbers[ids] for name, ids in by_name.items()},
        (counts[0], counts[1]) if counts else None,
        (
            *_leave_out(faint, "faint", FAINT_IS_BOLL),
            *_leave_out(middles.take(bare & ~white), "faint", FAINT_IS_BOLL),
            *_leave_out(middles.take(white), "white_thing", THING_IS_BOLL),
        ),
        round(joining, 3),
    )


def separate_all(
    votes: Sequence[Votes], lint: LintInSpace, up: Float64, cm_per_su: float | None = None
) -> list[Separated]:
    """The bolls by all votes; then, with enough views, those by every second view and those by the others.

    The halves show how much a result depends on the choice of images. All use the lint of the whole model."""
    parts = [votes]
    if len(votes) >= FEWEST_TO_HALVE:
        parts += [votes[0::2], votes[1::2]]
    return on_all_cores(lambda some: separate_bolls(some, lint, up, cm_per_su), parts)


def _instances(
    owner: NDArray[np.uint16],
    middles: Bolls,
    counted: NDArray[np.bool_],
    gaussians: Gaussians,
    images: Mapping[str, NDArray[np.uint16]],
) -> Iterator[BollInstance]:
    """The bolls that have Gaussians: a small one of a coarse model may have four, and all views know it.

    Args:
        owner: (N,) number of the middle of each Gaussian, from 1. images: the same of pixels.
        counted: (B,) which middles are bolls.
    """
    for number in np.flatnonzero(counted) + 1:
        rows = np.flatnonzero(owner == number)
        if not len(rows):
            continue
        centre, widths = measure_extent(gaussians.means[rows])
        views = tuple(sorted(name for name, ids in images.items() if (ids == number).any()))
        confidence = round(float(middles.one_boll[number - 1]), 3)
        doubts = ("disputed",) * (confidence < 0.5) + ("few_views",) * (len(views) < FEW_VIEWS)
        yield BollInstance(0, rows, views, centre, float(widths.mean()), confidence, doubts)


def _leave_out(middles: Middles, reason: str, probability: float) -> Iterator[LeftOut]:
    for centre, diameter in zip(middles.centres.tolist(), middles.diameters.tolist(), strict=True):
        yield LeftOut(tuple(centre), diameter, reason, probability)
