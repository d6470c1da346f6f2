"""Open bolls in the images of one plant: the bolls' network finds them, and all views together separate them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import LeftOut, MaskSet
from ..core.machine import on_all_cores, stream_on_all_cores
from ..core.runs import Progress, silent
from ..core.scene import Camera, Gaussians
from ..gaussians.rasterizer import Window
from .bolls import BollNetwork
from .lint_edges import open_edges
from .lint_in_space import LintInSpace, gather_lint
from .lint_owners import average_votes
from .meeting_votes import Middles, Votes, cast_votes
from .outline_bolls import outline_bolls
from .separate_bolls import Separated, separate_bolls
from .single_image import find_bolls
from .white_things import find_white_things, measure_surroundings

FAINT_IS_BOLL: Final = 0.25
"""Share of what is left out as faint that is a boll all the same: one of four on twenty simulated plants. Two were
things, and one was a part of a boll. ..."""
THING_IS_BOLL: Final = 0.1
"""... The same for a white thing. These plants had too few of them to measure it."""
FEWEST_TO_HALVE: Final = 12
"""Least number of views whose halves are compared. Halves of fewer views do not measure the whole."""


def detect_bolls(
    images: Sequence[NDArray[np.uint8]],
    cameras: Sequence[Camera],
    network: BollNetwork,
    gaussians: Gaussians | None = None,
    allowed: NDArray[np.bool_] | None = None,
    progress: Progress = silent,
    windows: Sequence[Window | None] | None = None,
    cm_per_su: float | None = None,
) -> MaskSet:
    """Masks of each image.

    Args:
        images: (H, W, 3) sRGB.
        cameras: theirs.
        gaussians: the plant's model, which combines the evidence of all images; None = each image is taken alone.
        allowed: (N,) which Gaussians may be a boll's; None = all.
        windows: the part of each image that shows the plant; with a model the network does not see the rest.
        cm_per_su: length of a scene unit; None = unknown.
    Returns:
        By camera name; with a model a boll has the same id in all images, and its score is the probability that it is
        one boll.
    """
    ids: dict[str, NDArray[np.uint16]] = {}
    scores: dict[str, dict[int, float]] = {}
    if gaussians is None:
        for done, (image, camera) in enumerate(zip(images, cameras, strict=True)):
            progress(done, len(images), camera.name)
            ids[camera.name], scores[camera.name] = find_bolls(image, network)
        return MaskSet(ids, scores)
    maps = []
    for done, (image, window) in enumerate(zip(images, windows or [None] * len(images), strict=True)):
        progress(done, 2 * len(images), cameras[done].name)
        maps.append(network.maps(image, window=window))
    lint = gather_lint(maps, cameras, gaussians, np.ones(len(gaussians), bool) if allowed is None else allowed)
    votes = on_all_cores(lambda number: cast_votes(maps[number], cameras[number], lint), range(len(maps)))
    (bolls, faint), *halves = separate_all(votes, lint, cm_per_su)
    owners = average_votes(votes, bolls)
    edges, likely = open_edges(), [of_image.lint for of_image in maps]
    seen = zip(images, likely, cameras, strict=True)
    outlined = stream_on_all_cores(lambda one: outline_bolls(*one, lint, owners, edges), seen)
    sums = np.zeros((len(bolls.centres), 4))
    for done, (camera, of_image) in enumerate(zip(cameras, outlined, strict=True)):
        progress(len(images) + done, 2 * len(images), camera.name)
        sums += measure_surroundings(maps[done], of_image, len(bolls.centres))
        ids[camera.name] = of_image
    things = np.flatnonzero(find_white_things(sums, bolls.support)) + 1
    for name, of_image in ids.items():
        of_image[np.isin(of_image, things)] = 0
        scores[name] = {int(k): round(float(bolls.one_boll[k - 1]), 3) for k in np.unique(of_image) if k}
    counts = [int((~np.isin(bolls.nearest(half.bolls.centres), things)).sum()) for half in halves]
    left_out = (
        *_leave_out(faint, "faint", FAINT_IS_BOLL),
        *_leave_out(bolls.take(things - 1), "white_thing", THING_IS_BOLL),
    )
    return MaskSet(ids, scores, together=True, halves=(counts[0], counts[1]) if counts else None, left_out=left_out)


def _leave_out(middles: Middles, reason: str, probability: float) -> Iterator[LeftOut]:
    for centre, diameter in zip(middles.centres.tolist(), middles.diameters.tolist(), strict=True):
        yield LeftOut(tuple(centre), diameter, reason, probability)


def separate_all(votes: Sequence[Votes], lint: LintInSpace, cm_per_su: float | None = None) -> list[Separated]:
    """The bolls from all votes, and, if there are enough views, those from every second view and those from the other
    half: what other images would have given. All of them take the places of lint from all views."""
    parts = [votes]
    if len(votes) >= FEWEST_TO_HALVE:
        parts += [votes[0::2], votes[1::2]]
    return on_all_cores(lambda some: separate_bolls(some, lint, cm_per_su), parts)
