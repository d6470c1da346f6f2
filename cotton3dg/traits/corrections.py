# SPDX-License-Identifier: Apache-2.0
"""Applies a person's corrections of the bolls: merged, split, deleted, added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import BollInstance, LeftOut
from ..core.measurements import PlantFrame
from ..core.scene import Float64, Gaussians
from ..geometry.point_sets import find_compact_part, measure_extent
from ..schemas.corrections import Correction, Place

NEAR: Final = 0.5
"""Largest distance, in diameters of the boll, between its centre and the place of a correction that refers to it."""
LEAST_GAUSSIANS: Final = 5
REACH: Final = 0.9
"""Reach of an added boll around its place, in usual diameters: bolls differ, and picks err."""
AS_WHITE: Final = 0.2
"""Quantile of the other bolls' whiteness that the Gaussians of an added boll reach; darker ones are wood and leaves."""
USUAL_CM: Final = 4.5
"""Diameter of an open boll, used where the plant has no other boll to take it from."""
ADDED_OPACITY: Final = 0.1
"""Least opacity of an added boll's Gaussians; fainter ones are haze."""


@dataclass(frozen=True)
class Corrected:
    """Bolls after the corrections."""

    bolls: list[BollInstance]
    """Bolls without a correction keep their numbers. Merged bolls get the smallest of their numbers."""
    origins: dict[int, tuple[int, ...]] = field(default_factory=dict)
    """Number of a corrected boll -> those of the bolls that it comes from; none for an added boll."""
    words: dict[int, str] = field(default_factory=dict)
    """Corrected boll -> the correction in words."""
    applied: int = 0
    refused: tuple[str, ...] = ()
    """The reason for each correction that does not apply."""

    @property
    def added(self) -> list[int]:
        return [boll_id for boll_id, word in self.words.items() if word == "added"]


def still_left_out(left_out: Sequence[LeftOut], bolls: Sequence[BollInstance]) -> list[LeftOut]:
    """The items of `left_out` that no boll contains after the corrections either."""
    return [
        thing
        for thing in left_out
        if all(np.linalg.norm(boll.centre - thing.centre_su) > 0.5 * thing.diameter_su for boll in bolls)
    ]


def apply_corrections(
    bolls: Sequence[BollInstance],
    corrections: Sequence[Correction],
    gaussians: Gaussians,
    model: str,
    frame: PlantFrame | None,
) -> Corrected:
    """Apply corrections one after the other.

    Args:
        model: `gaussians.sha256()`. frame: None without a scale; then only corrections of this very model apply.
    """
    now = {boll.boll_id: boll for boll in bolls}
    origins: dict[int, tuple[int, ...]] = {boll_id: (boll_id,) for boll_id in now}
    words: dict[int, str] = {}
    refused: list[str] = []
    next_id = max(now, default=0) + 1
    for correction in corrections:
        problem = correction.problem()
        places = [_scene_place(place, correction, model, frame) for place in correction.bolls]
        if not problem and any(place is None for place in places):
            problem = "its place is not known in this model; it refers to another one, without a scale"
        if problem:
            refused.append(f"{correction.summary}: {problem}")
            continue
        known = [place for place in places if place is not None]
        if correction.kind == "add":
            made = _added(known, now, gaussians, frame, next_id)
            if isinstance(made, str):
                refused.append(f"add: {made}")
                continue
            now[next_id], origins[next_id], words[next_id] = made, (), "added"
            next_id += 1
            continue
        found = [_boll_at(place, now) for place in known]
        if None in found or len(set(found)) < len(found):
            refused.append(f"{correction.summary}: no boll is there any more")
            continue
        ids = [boll_id for boll_id in found if boll_id is not None]
        sources = tuple(sorted({source for boll_id in ids for source in origins[boll_id]}))
        if correction.kind == "merge":
            kept = min(ids)
            now[kept] = _merged(kept, [now[boll_id] for boll_id in sorted(ids)], gaussians)
            for boll_id in set(ids) - {kept}:
                del now[boll_id], origins[boll_id]
                words.pop(boll_id, None)
            origins[kept], words[kept] = sources, "merged"
        elif correction.kind == "split":
            parts = _split(now[ids[0]], gaussians, next_id)
            if parts is None:
                refused.append(f"{correction.summary}: too few Gaussians for two bolls")
                continue
            for part in parts:
                now[part.boll_id], origins[part.boll_id], words[part.boll_id] = part, sources, "split"
            next_id += 1
        else:
            del now[ids[0]], origins[ids[0]]
            words.pop(ids[0], None)
    return Corrected(
        [now[boll_id] for boll_id in sorted(now)],
        {boll_id: origins[boll_id] for boll_id in sorted(words)},
        words,
        len(corrections) - len(refused),
        tuple(refused),
    )


def _scene_place(place: Place, correction: Correction, model: str, frame: PlantFrame | None) -> Float64 | None:
    """(3,) su of a place; None if it is unknown in this scene."""
    if place.centre_su is not None and correction.model == model:
        return np.array(place.centre_su, np.float64)
    if place.centre_cm is not None and frame is not None and np.isfinite(place.centre_cm).all():
        return frame.scene(place.centre_cm)
    return None


def _boll_at(place: Float64, bolls: dict[int, BollInstance]) -> int | None:
    """The boll whose centre is nearest, if it is near."""
    if not bolls:
        return None
    away = {boll_id: float(np.linalg.norm(boll.centre - place)) for boll_id, boll in bolls.items()}
    nearest = min(away, key=lambda boll_id: (away[boll_id], boll_id))
    return nearest if away[nearest] <= NEAR * bolls[nearest].diameter_su else None


def _of(boll: BollInstance, boll_id: int, indices: NDArray[np.int64], gaussians: Gaussians) -> BollInstance:
    """A boll with other Gaussians, which a person chose."""
    centre, widths = measure_extent(gaussians.means[indices])
    return replace(
        boll,
        boll_id=boll_id,
        indices=indices,
        centre=centre,
        diameter_su=float(widths.mean()),
        confidence=1.0,
        flags=(),
    )


def _merged(boll_id: int, bolls: list[BollInstance], gaussians: Gaussians) -> BollInstance:
    whole = _of(bolls[0], boll_id, np.unique(np.concatenate([boll.indices for boll in bolls])), gaussians)
    views = tuple(sorted({view for boll in bolls for view in boll.views}))
    return replace(whole, views=views, masks=tuple(sorted({mask for boll in bolls for mask in boll.masks})))


def _split(boll: BollInstance, gaussians: Gaussians, new_id: int) -> tuple[BollInstance, BollInstance] | None:
    """Two halves by Lloyd's algorithm from the ends of the boll's longest axis; None if it has too few Gaussians."""
    from scipy.cluster.vq import kmeans2

    points = np.asarray(gaussians.means[boll.indices], np.float64)
    if len(points) < 2 * LEAST_GAUSSIANS:
        return None
    mean = points.mean(axis=0)
    axis = np.linalg.svd(points - mean, full_matrices=False)[2][0]
    along = (points - mean) @ axis
    ends = points[[int(along.argmin()), int(along.argmax())]]
    halves = kmeans2(points, ends, iter=50, minit="matrix", missing="warn")[1]
    if min((halves == 0).sum(), (halves == 1).sum()) < LEAST_GAUSSIANS:
        return None
    # The half with more Gaussians keeps the number and the masks.
    larger = int((halves == 1).sum() > (halves == 0).sum())
    first = _of(boll, boll.boll_id, boll.indices[halves == larger], gaussians)
    second = _of(boll, new_id, boll.indices[halves != larger], gaussians)
    return first, replace(second, masks=())


def _added(
    places: Sequence[Float64],
    bolls: dict[int, BollInstance],
    gaussians: Gaussians,
    frame: PlantFrame | None,
    boll_id: int,
) -> BollInstance | str:
    """A boll of the usual size at a place, from Gaussians without a boll; or the reason why there cannot be one."""
    if not places or not (bolls or frame):
        return "neither another boll nor a scale tells how large it may be" if places else "its place is not known"
    usual_su = USUAL_CM / frame.scale.cm_per_su if frame else np.nan
    taken = gaussians.opacities > ADDED_OPACITY
    if bolls:
        usual_su = float(np.median([boll.diameter_su for boll in bolls.values()]))
        others = np.concatenate([boll.indices for boll in bolls.values()])
        whiteness = gaussians.colours.min(axis=1)
        taken &= whiteness >= np.quantile(whiteness[others], AS_WHITE)
        taken[others] = False
    near = np.linalg.norm(gaussians.means - places[0], axis=1) <= REACH * usual_su
    indices = np.flatnonzero(near & taken)
    if len(indices) >= LEAST_GAUSSIANS:
        indices = indices[find_compact_part(gaussians.means[indices])]
    if len(indices) < LEAST_GAUSSIANS:
        return "the model has no lint there that does not belong to another boll"
    return _of(BollInstance(boll_id, indices, (), places[0], usual_su, 1.0), boll_id, indices, gaussians)
