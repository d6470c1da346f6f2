# SPDX-License-Identifier: Apache-2.0
"""Estimates the scale by the chosen reference, or by all available ones, with pictures that show them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.runs import Progress, StageOutcome, silent
from ..core.scene import Camera
from ..geometry.camera_orbit import azimuths, evenly_spaced, fit_orbit
from ..options import ScaleOptions
from ..schemas.scale import NO_SOURCE, ScaleInfo
from .card import CARD_MARKERS, read_patches, scale_from_card
from .markers import Corner, MarkerKind, board_squares, draw_crosses, find_markers, outline_markers, scale_from_markers
from .rectangle import Rectangle
from .references import NoReference, Reconciled, Reference, find_ground, reconcile, scale_on
from .sections import cut_table, draw_sections, scale_from_all_sections, scale_from_central_section
from .table import NoTable, TableFit, find_table, outline_table, scale_from_table
from .two_points import scale_from_distance

VIEWS: Final = 40
"""Number of photos in which the rim of the table is measured."""
PICTURES: Final = 3
TABLE_SOURCES: Final = frozenset(("table", "sections", "all-sections", "corners"))
"""References that the table gives."""
TABLE_SIZE_ASSUMED: Final = "table_size_assumed"
NO_GROUND: Final = NoReference("no level plane is bounded like a table")
Pictures = dict[str, NDArray[np.uint8]]


@dataclass(frozen=True)
class Plant:
    """The scene and photos in which references are searched."""

    cameras: list[Camera]
    photo: Callable[[str], NDArray[np.uint8]]
    """Name of a camera -> (H, W, 3) RGB."""
    tracks: NDArray[np.float64]
    """(T, 3) su, triangulated points."""
    solid: NDArray[np.float32]
    """(S, 3) su, means of the opaque Gaussians."""
    picks: Mapping[str, Mapping[str, NDArray[np.float64]]] | None = None
    """Point that the user picked -> image -> (2,) px; None without any points."""


@dataclass(frozen=True)
class FoundScale:
    """The scale, or the reason why there is none, with its evidence."""

    info: ScaleInfo
    outcome: StageOutcome
    pictures: Pictures = field(default_factory=dict)
    """File name -> photo with the reference drawn on it."""
    patches: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """Photo -> (6, 3) grey levels of the card's patches, if the card was searched."""


@dataclass(frozen=True)
class _Scene:
    """The plant with its table."""

    plant: Plant
    points: NDArray[np.float64]
    """(N, 3) su, of the surfaces."""
    chosen: list[Camera]
    photos: list[NDArray[np.uint8]]
    """Photos of the chosen cameras."""
    table: TableFit | NoTable
    ground: Rectangle | None
    """The table top, else the highest large level plane."""

    @cached_property
    def card_views(self) -> list[tuple[dict[Corner, NDArray[np.float64]], NDArray[np.float64] | None]]:
        """Corners of the card's markers in the photo of each camera, and the levels of its patches."""
        views = []
        for camera in self.plant.cameras:
            photo = self.plant.photo(camera.name)
            corners = find_markers(photo, CARD_MARKERS)
            views.append((corners, read_patches(photo, corners)))
        return views

    def shown(self) -> list[tuple[Camera, NDArray[np.uint8]]]:
        """Photos for pictures, from around the plant."""
        return [(self.chosen[i], self.photos[i]) for i in (n * len(self.chosen) // PICTURES for n in range(PICTURES))]


def estimate_scale(plant: Plant, options: ScaleOptions, progress: Progress = silent, views: int = VIEWS) -> FoundScale:
    """Search the references that the method names, and reconcile their scales.

    Args:
        views: largest number of photos in which the rim of the table is measured.
    """
    wanted = [options.method]
    if options.method == "all":
        wanted = ["table", "aruco", "card", *(["distance"] if plant.picks is not None else [])]
    scene = _scene(plant, options, progress, views)
    references: list[Reference] = []
    refused: dict[str, str] = {}
    pictures: Pictures = {}
    for source in wanted:
        progress(len(scene.chosen), len(scene.chosen) + 1, source)
        found, shown = _FIND[source](scene, options)
        pictures |= shown
        if isinstance(found, NoReference):
            refused[source] = found.reason
        else:
            references.append(replace(found, assumed=source in TABLE_SOURCES and options.table_is_assumed))
    patches = {}
    if "card" in wanted:
        seen = zip(plant.cameras, scene.card_views, strict=True)
        patches = {camera.name: levels for camera, (_, levels) in seen if levels is not None}
    if scene.ground is None:
        references, refused["plane"] = [], "no level plane lies below the cameras"
    if not references or scene.ground is None:
        reason = "; ".join(f"{source}: {why}" for source, why in refused.items())
        found_none = no_scale(reason, f"no scale was found ({reason}); {_REMEDY[options.method]}")
        return replace(found_none, patches=patches)
    progress(len(scene.chosen) + 1, len(scene.chosen) + 1)
    together = reconcile(references)
    scale = scale_on(scene.ground, together.cm_per_su, together.relative_error, "+".join(together.agreeing))
    evidence = next(item.evidence for item in references if item.source == together.agreeing[0])
    info = ScaleInfo.of_scale(
        scale,
        evidence=evidence,
        references=facts_of(references),
        refused=refused,
        **table_of(together, options),
    )
    summary = summary_of(info, evidence)
    unclear = "table" in together.agreeing and isinstance(scene.table, TableFit) and bool(scene.table.unclear_edges)
    return FoundScale(info, StageOutcome(summary, *warnings_of(together, unclear)), pictures, patches)


def no_scale(reason: str, *warnings: str) -> FoundScale:
    """The result without a scale, with the reason; the metric cells stay blank."""
    return FoundScale(ScaleInfo(NO_SOURCE, reason), StageOutcome({"source": NO_SOURCE}, ("no_scale",), warnings))


def _scene(plant: Plant, options: ScaleOptions, progress: Progress, views: int) -> _Scene:
    cameras = plant.cameras
    points = np.concatenate([plant.tracks, plant.solid]).astype(np.float64)
    chosen = [cameras[i] for i in evenly_spaced(azimuths(cameras, fit_orbit(cameras)), views)]
    photos = []
    for number, camera in enumerate(chosen):
        progress(number, len(chosen) + 1, "photos of the table")
        photos.append(plant.photo(camera.name))
    aspect = options.table_cm[0] / options.table_cm[1]
    table = find_table(points, cameras, photos, chosen, tracks=plant.tracks, aspect=aspect)
    ground = table.rectangle if isinstance(table, TableFit) else find_ground(points, cameras)
    return _Scene(plant, points, chosen, photos, table, ground)


def _table(scene: _Scene, options: ScaleOptions) -> tuple[Reference | NoReference, Pictures]:
    if isinstance(scene.table, NoTable):
        return NoReference(scene.table.reason), {}
    scale = scale_from_table(scene.table, *options.table_cm)
    reference = Reference("table", scale.cm_per_su, scale.relative_error, _evidence(scene.table))
    return reference, _table_pictures(scene, scene.table.rectangle)


def _sections(scene: _Scene, options: ScaleOptions) -> tuple[Reference | NoReference, Pictures]:
    if scene.ground is None:
        return NO_GROUND, {}
    cut = cut_table(scene.points, scene.ground, fit_orbit(scene.plant.cameras).radius)
    if isinstance(cut, NoReference):
        return cut, {}
    pictures = _table_pictures(scene, scene.ground) | {"sections.jpg": draw_sections(cut)}
    return scale_from_central_section(cut, options.table_cm[1]), pictures


def _all_sections(scene: _Scene, options: ScaleOptions) -> tuple[Reference | NoReference, Pictures]:
    if scene.ground is None:
        return NO_GROUND, {}
    radius = fit_orbit(scene.plant.cameras).radius
    found = scale_from_all_sections(scene.points, scene.ground, *options.table_cm, radius)
    return found, _table_pictures(scene, scene.ground)


def _aruco(scene: _Scene, options: ScaleOptions) -> tuple[Reference | NoReference, Pictures]:
    printed = options.aruco
    kind = MarkerKind(printed.dictionary, printed.marker_cm, board_squares(printed.board))
    found = [find_markers(scene.plant.photo(camera.name), kind) for camera in scene.plant.cameras]
    fit = scale_from_markers(scene.plant.cameras, found, kind)
    if isinstance(fit, NoReference):
        return fit, {}
    shown = [outline_markers(photo, camera, fit.sightings) for camera, photo in scene.shown()]
    return fit.reference, {f"markers_{number}.jpg": picture for number, picture in enumerate(shown)}


def _card(scene: _Scene, options: ScaleOptions) -> tuple[Reference | NoReference, Pictures]:
    found = [corners for corners, _ in scene.card_views]
    fit = scale_from_card(scene.plant.cameras, found, options.card.ruler_cm)
    if isinstance(fit, NoReference):
        return fit, {}
    shown = [outline_markers(photo, camera, fit.sightings) for camera, photo in scene.shown()]
    return fit.reference, {f"card_{number}.jpg": picture for number, picture in enumerate(shown)}


def _distance(scene: _Scene, options: ScaleOptions) -> tuple[Reference | NoReference, Pictures]:
    found = scale_from_distance(scene.plant.cameras, scene.plant.picks or {}, options.distance.distance_cm)
    if isinstance(found, NoReference):
        return found, {}
    reference, points = found
    shown = [draw_crosses(photo, camera, points) for camera, photo in scene.shown()]
    return reference, {f"points_{number}.jpg": picture for number, picture in enumerate(shown)}


_FIND: Final = {
    "table": _table,
    "sections": _sections,
    "all-sections": _all_sections,
    "aruco": _aruco,
    "card": _card,
    "distance": _distance,
}
_TABLE_REMEDY: Final = (
    "film so that all of the table top is seen, or give its size with --table-length-cm and --table-width-cm"
)
_REMEDY: Final = {
    "table": _TABLE_REMEDY,
    "sections": _TABLE_REMEDY,
    "all-sections": _TABLE_REMEDY,
    "aruco": "lay printed markers (cotton3dg markers) of at least 10 cm flat beside the plant and give --marker-cm",
    "card": "lay the plant's card (cotton3dg cards) flat beside it, all of it in view all around",
    "distance": "pick both points in more images of sfm/undistorted/images",
    "all": "film so that all of the table top is seen, or lay printed markers (cotton3dg markers) beside the plant",
}


def _table_pictures(scene: _Scene, rectangle: Rectangle) -> Pictures:
    return {
        f"table_{number}.jpg": outline_table(photo, camera, rectangle)
        for number, (camera, photo) in enumerate(scene.shown())
    }


def warnings_of(together: Reconciled, unclear_edge: bool) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Flags and warnings of a scale."""
    flags, warnings = [], []
    if together.assumed:
        flags.append(TABLE_SIZE_ASSUMED)  # the size is stated where it matters, so a warning is not needed
    if unclear_edge:
        flags.append("table_edge_unclear")
        warnings.append(
            "one edge of the table does not stand out from what is behind it; the scale rests on the other sides; "
            "lay something of another colour below the table, or a printed marker on it"
        )
    if together.relative_error > 0.01:
        flags.append("scale_uncertain")
        warnings.append(
            f"the scale is known to {100 * together.relative_error:.1f} % only; look at the pictures in scale/ and "
            "check the sizes that were given"
        )
    for source, difference in together.differing.items():
        flags.append("references_disagree")
        warnings.append(
            f"{source} gives a scale {100 * difference:+.1f} % off that of {together.agreeing[0]}, which was taken; "
            "check their sizes"
        )
    return tuple(dict.fromkeys(flags)), tuple(warnings)


def table_of(together: Reconciled, options: ScaleOptions) -> dict[str, Any]:
    """The table's size for scale.json, if the scale depends on it."""
    if TABLE_SOURCES.isdisjoint(together.agreeing):
        return {}
    return {"table_cm": options.table_cm, "table_assumed": together.assumed}


def summary_of(info: ScaleInfo, evidence: dict[str, Any]) -> dict[str, Any]:
    """Figures of a scale for the record of the stage."""
    found = {"cm_per_su": info.cm_per_su, "error_pct": 100 * (info.relative_error or 0.0)}
    return found | ({"table": info.table_words.removeprefix("table ")} if info.table_words else {}) | evidence


def facts_of(references: list[Reference]) -> tuple[dict[str, Any], ...]:
    """The facts of each reference."""
    return tuple(
        {"source": item.source, "cm_per_su": item.cm_per_su, "relative_error": item.relative_error, **item.evidence}
        for item in references
    )


def _evidence(fit: TableFit) -> dict[str, Any]:
    evidence: dict[str, Any] = {"aspect": fit.aspect, "fill": fit.fill, "inliers": fit.inliers}
    if fit.rim:
        evidence["edge_residuals_px"] = list(fit.rim.residual_px)
        evidence["edge_support"] = list(fit.rim.support)
        evidence["edge_views"] = list(fit.rim.views)
    return evidence
