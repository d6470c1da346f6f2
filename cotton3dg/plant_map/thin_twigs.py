# SPDX-License-Identifier: Apache-2.0
"""Twigs that the model lacks, followed in the photos.

A twig about as thin as a pixel may be missing from a trained model where it hardly differs from its background, yet
every photo shows a trace of it. So at each end of an axis of the map, walks of short steps that turn little are tried.
Those that the photos confirm go on, and the best of them is the trail. It ends where the twig does, or leads over a gap
to wood in the model. This is not in the papers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.machine import on_all_cores
from ..core.measurements import Scale
from ..core.plant_map import PlantMap
from ..core.scene import Camera, Float64, Gaussians
from ..gaussians.rasterizer import render
from ..geometry.polylines import path_lengths, place_at, resampled
from .photo_lines import PhotoLines

VIEWS: Final = 60
LONGER_PX: Final = 960
"""Longer side of the photos that are used, px."""
VEILED: Final = 0.1
"""Opacity of the plant's model from which on a pixel says nothing about twigs that the model lacks."""
STEP_CM: Final = 1.0
SPACING_CM: Final = 0.25
"""Spacing of the places of a trail."""
PLACES: Final = 4
"""Number of places that are measured on each step."""
TURNS_DEG: Final = {10: 5, 22: 8}
"""Angle by which a step may turn from the one before -> number of sides to which it may turn."""
MOST_TURNED_DEG: Final = 60.0
"""Largest turn from an axis's own direction; a walk that turns more follows something else."""
HEADING_CM: Final = 2.5
"""Length of an axis's end that gives its direction."""
BEAM: Final = 8
"""Number of walks that go on at once, ..."""
APART_CM: Final = 0.35
"""... and least distance of their ends."""
LONGEST_CM: Final = 25.0
RETREATS_CM: Final = (0.0, 1.5)
"""Distances before an axis's end at which walks begin; the next one is tried if no walk succeeds from the one before,
because a speck beside a twig may bend the axis."""
HIDDEN_STEPS: Final = 3
"""Number of steps with which a walk may begin without evidence from any photo, just beside the model's own end."""
SHOWN_SHARE: Final = 0.12
"""Share of the views with evidence below which a step is hidden."""
LIKELY_COVERAGE: Final = 0.35
"""Coverage by a lost twig. A step's gain is the log likelihood ratio of the photos with and without such a twig."""
LEAST_COVERAGE: Final = 0.22
"""Least coverage of a step, and of its median over views. Where there is no twig, texture gives up to 0.2."""
BLOCKS: Final = 12
"""Number of groups of neighbouring views. The views of a group have similar backgrounds and count as one; the groups
differ by chance."""
WINDOW: Final = 3
"""Number of steps whose coverage together has to be ..."""
LEAST_EVIDENCE: Final = 4.5
"""... at least this many standard errors above zero."""
LEAST_GAIN: Final = 250.0
"""Least gain of a whole walk. Of the walks used to choose it, true ones gained 500 and more, most false ones up to 125
(docs/notes/stated_errors.md)."""
BEND_COST: Final = 20.0
"""Reduction of the gain for 1 - cos of each turn."""
FADED: Final = 0.6
"""Share of the usual coverage on a walk; fainter steps at its end do not belong to it."""


@dataclass(frozen=True)
class _Walk:
    """The steps so far from an axis's end."""

    places: tuple[Float64, ...]
    """Places of the end and of each step, (3,) cm."""
    heading: Float64
    """(3,) direction of the last step."""
    steps: tuple[Float64, ...] = ()
    """(2, V) evidence of each; zeros where hidden."""
    gain: float = 0.0

    def without_last(self) -> _Walk:
        before = self.places[-2] - self.places[-3]
        return _Walk(self.places[:-1], before / np.linalg.norm(before), self.steps[:-1])

    @property
    def shown(self) -> list[Float64]:
        """The steps for which photos give evidence."""
        return [step for step in self.steps if step[1].any()]


@dataclass(frozen=True)
class Trail:
    """The continuation of an axis where the model ends."""

    places: Float64
    """(K, 3) cm, from its last place in the model to its last place in the photos, about `SPACING_CM` apart."""
    meets_model: bool
    """Whether it leads to wood in the model: over a gap in a branch, not to a twig's end."""


def follow_thin_twigs(
    plant_map: PlantMap,
    opaque: Gaussians,
    scale: Scale,
    foot: Float64,
    cameras: Sequence[Camera],
    photo: Callable[[str], NDArray[np.uint8]],
) -> list[Trail]:
    """The trails of axes that end in the model but go on in the photos.

    Args:
        opaque: Gaussians of the plant with its bolls, without those too faint to be measured.
        foot: (3,) su, origin of the plant frame. photo: the image (H, W, 3) of a camera's name.
    """
    if not plant_map.axes or not len(cameras):
        return []
    lines = _look_at(opaque, scale, foot, cameras, photo)
    colours = lines.colours(np.concatenate([axis.curve for axis in plant_map.axes]))
    found = [_follow(axis.curve, lines, colours) for axis in plant_map.axes if len(axis.curve) > 1]
    return [trail for trail in found if trail]


def _look_at(
    opaque: Gaussians,
    scale: Scale,
    foot: Float64,
    cameras: Sequence[Camera],
    photo: Callable[[str], NDArray[np.uint8]],
) -> PhotoLines:
    """Photos from all around, with the model of the plant hidden, for lines in the plant frame, cm."""
    import cv2

    chosen = np.linspace(0, len(cameras) - 1, min(VIEWS, len(cameras))).round().astype(int)
    views = [_zoomed(cameras[number]) for number in chosen]

    def shrunk(view: Camera) -> NDArray[np.uint8]:
        small: NDArray[np.uint8] = cv2.resize(photo(view.name), (view.width, view.height), interpolation=cv2.INTER_AREA)
        return small

    placed, hidden = [], []
    for small in views:
        veiled = render(opaque, small).transmittance < 1 - VEILED
        hidden.append(cv2.dilate(veiled.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool))
        rotation = small.rotation @ scale.table_frame.T
        shift = (small.rotation @ foot + small.cam_from_scene[:, 3]) * scale.cm_per_su
        placed.append(replace(small, cam_from_scene=np.column_stack([rotation, shift])))
    return PhotoLines(placed, on_all_cores(shrunk, views), hidden)


def _zoomed(camera: Camera) -> Camera:
    """The same camera with a picture of at most `LONGER_PX` px on its longer side."""
    zoom = min(1.0, LONGER_PX / max(camera.width, camera.height))
    return camera.resized(max(1, round(zoom * camera.width)), max(1, round(zoom * camera.height)))


def _follow(curve: Float64, lines: PhotoLines, colours: Float64) -> Trail | None:
    """The trail of an axis; None if it does not go on."""
    _, below = lines.evidence(curve, np.gradient(curve, axis=0), colours)
    # A part that is too faint to count as hidden by the model is not measured in it, either.
    modelled = np.flatnonzero((below > 0).mean(axis=0) <= SHOWN_SHARE)
    curve = curve[: max(int(modelled[-1]) if len(modelled) else 0, 1) + 1]
    length_cm = path_lengths(curve)[-1]
    for retreat_cm in RETREATS_CM:
        best = _walked(curve, length_cm - retreat_cm, lines, colours)
        if best.gain >= LEAST_GAIN:
            places = resampled(np.array(best.places[: 1 + _unfaded(best)]), SPACING_CM)
            return Trail(places, _meets_model(best, lines, colours))
    return None


def _walked(curve: Float64, from_cm: float, lines: PhotoLines, colours: Float64) -> _Walk:
    """The likeliest walk from a place on an axis."""
    start = place_at(curve, max(from_cm, 0.0))
    chord = start - place_at(curve, max(from_cm - HEADING_CM, 0.0))
    heading = chord / max(float(np.linalg.norm(chord)), 1e-12)
    best = _Walk((start,), heading)
    beam = [best]
    while beam and len(beam[0].steps) < LONGEST_CM / STEP_CM:
        beam = _best_apart([walk for walk in _extended(beam, lines, colours) if _is_borne_out(walk, heading)])
        best = max([best, *beam], key=lambda walk: walk.gain)
    return best


def _extended(walks: Sequence[_Walk], lines: PhotoLines, colours: Float64) -> list[_Walk]:
    """Each walk by one step to each side."""
    on = [(walk, heading) for walk in walks for heading in _turned(walk.heading)]
    shares = (np.arange(PLACES) + 0.5) / PLACES
    places = np.array([walk.places[-1] + STEP_CM * share * heading for walk, heading in on for share in shares])
    above, below = lines.evidence(places, np.repeat([heading for _, heading in on], PLACES, axis=0), colours)
    shape = (len(lines), len(on), PLACES)
    shown = (below.reshape(shape) > 0).mean(axis=(0, 2)) > SHOWN_SHARE
    steps = np.stack([above.reshape(shape).sum(axis=2), below.reshape(shape).sum(axis=2)]) * shown
    longer = []
    for (walk, heading), step in zip(on, np.moveaxis(steps, 2, 0), strict=True):
        of_photos = 2 * LIKELY_COVERAGE * step[0].sum() - LIKELY_COVERAGE**2 * step[1].sum()
        gain = walk.gain + of_photos - BEND_COST * (1 - walk.heading @ heading)
        ends = (*walk.places, walk.places[-1] + STEP_CM * heading)
        longer.append(_Walk(ends, heading, (*walk.steps, step), gain))
    return longer


def _is_borne_out(walk: _Walk, heading: Float64) -> bool:
    if walk.heading @ heading < np.cos(np.radians(MOST_TURNED_DEG)):
        return False
    if not walk.steps[-1][1].any():
        # Only steps just beside the model's own end may be hidden; a walk that is hidden later has met the model again.
        return not walk.shown and len(walk.steps) <= HIDDEN_STEPS
    shown = np.array(walk.shown[-WINDOW:])
    groups = np.array([group.sum(axis=1) for group in np.array_split(shown.sum(axis=0), BLOCKS, axis=1)])
    coverage = groups[:, 0].sum() / groups[:, 1].sum()
    error = float(np.linalg.norm(groups[:, 0] - coverage * groups[:, 1])) / groups[:, 1].sum()
    each = groups[groups[:, 1] > 0]
    usual = np.median(each[:, 0] / each[:, 1])
    borne_out: bool = min(_coverage(walk.steps[-1]), usual) > LEAST_COVERAGE and coverage > LEAST_EVIDENCE * error
    return borne_out


def _meets_model(walk: _Walk, lines: PhotoLines, colours: Float64) -> bool:
    """Whether a walk leads to wood in the model: over a gap in a branch, not to a twig's end.

    Its last step may have turned aside from the wood, so the place before counts, too.
    """
    ends = [walk, walk.without_last()] if len(walk.shown) > 2 else [walk]
    return not all(longer.steps[-1][1].any() for longer in _extended(ends, lines, colours))


def _best_apart(walks: Sequence[_Walk]) -> list[_Walk]:
    kept: list[_Walk] = []
    for walk in sorted(walks, key=lambda walk: -walk.gain):
        if all(np.linalg.norm(walk.places[-1] - other.places[-1]) > APART_CM for other in kept):
            kept.append(walk)
        if len(kept) == BEAM:
            break
    return kept


def _unfaded(walk: _Walk) -> int:
    """Number of a walk's steps without those at its end that are far fainter than usual on it."""
    coverages = np.array([_coverage(step) for step in walk.steps])
    return int(np.flatnonzero(coverages >= FADED * np.nanmedian(coverages))[-1]) + 1


def _coverage(step: Float64) -> float:
    """Coverage of a step; NaN if it was hidden."""
    above, below = step.sum(axis=1)
    return float(above / below) if below > 0 else np.nan


def _turned(heading: Float64) -> list[Float64]:
    """Unit vectors: straight on, and to all sides by each of `TURNS_DEG`."""
    side = np.cross(heading, np.eye(3)[int(np.argmin(np.abs(heading)))])
    side /= np.linalg.norm(side)
    other = np.cross(heading, side)
    turned = [heading]
    for degrees, count in TURNS_DEG.items():
        for around in 2 * np.pi * np.arange(count) / count:
            sideways = np.cos(around) * side + np.sin(around) * other
            turned.append(np.cos(np.radians(degrees)) * heading + np.sin(np.radians(degrees)) * sideways)
    return turned
