"""Metric scale and up axis from things of known size."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.outcome import StageOutcome
from ..core.progress import Progress, silent
from ..core.scene import Camera
from ..documents.scale import NO_SOURCE, ScaleInfo
from ..errors import BadUsage, MissingInput, NoScale
from ..files.colmap import read_cameras, read_points
from ..files.images import read_image, write_image
from ..files.picks import COLUMNS, read_picks
from ..files.ply import read_gaussians
from ..geometry.camera_orbit import azimuths, evenly_spaced, fit_orbit
from ..options import ScaleOptions, board_squares
from ..scale.markers import MarkerKind, draw_crosses, find_markers, outline_markers, scale_from_markers
from ..scale.rectangle import Rectangle
from ..scale.references import NoReference, Reconciled, Reference, find_ground, reconcile, scale_on
from ..scale.sections import scale_from_sections
from ..scale.table import NoTable, TableFit, find_table, outline_table, scale_from_table
from ..scale.two_points import scale_from_distance
from ..workspace import Workspace
from .stage import Cost, Stage

VIEWS = 40
"""Photos in which the rim of the table is measured."""
PICTURES = 3
Pictures = dict[str, NDArray[np.uint8]]


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted, workspace.gaussians_ply, workspace.scale_points]


@dataclass(frozen=True)
class _Scene:
    """What the references are sought in."""

    workspace: Workspace
    cameras: list[Camera]
    points: NDArray[np.float64]
    """(N, 3) su, of the surfaces."""
    chosen: list[Camera]
    photos: list[NDArray[np.uint8]]
    """Of the chosen cameras."""
    table: TableFit | NoTable
    ground: Rectangle | None
    """The table top, or else the highest large level plane."""

    def shown(self) -> list[tuple[Camera, NDArray[np.uint8]]]:
        """Photos for pictures, from around the plant."""
        return [(self.chosen[i], self.photos[i]) for i in (n * len(self.chosen) // PICTURES for n in range(PICTURES))]


def run(workspace: Workspace, options: ScaleOptions, progress: Progress = silent) -> StageOutcome:
    """Writes scale.json and photos that show the reference: table_<n>.jpg, markers_<n>.jpg or points_<n>.jpg.

    Raises:
        NoScale: no reference was found although `require_scale` is set.
    """
    workspace.require(workspace.undistorted / "sparse", "sfm")
    workspace.require(workspace.gaussians_ply, "train")
    if options.method == "none":
        return _without(workspace, options, "no reference was asked for", ())
    wanted = [options.method]
    if options.method == "all":
        wanted = ["table", "aruco", *(["distance"] if workspace.scale_points.exists() else [])]
    if "distance" in wanted:
        _check_points(workspace, options)
    scene = _load(workspace, options, progress)
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
            references.append(found)
    if scene.ground is None:
        references, refused["plane"] = [], "no level plane lies below the cameras"
    if not references or scene.ground is None:
        reason = "; ".join(f"{source}: {why}" for source, why in refused.items())
        return _without(workspace, options, reason, (f"no scale was found ({reason}); {_REMEDY[options.method]}",))
    together = reconcile(references)
    scale = scale_on(scene.ground, together.cm_per_su, together.relative_error, "+".join(together.agreeing))
    evidence = next(item.evidence for item in references if item.source == together.agreeing[0])
    info = ScaleInfo.of_scale(scale, evidence=evidence, references=_facts(references), refused=refused)
    with workspace.writing("scale") as folder:
        info.save(folder / workspace.scale_json.name)
        for name, picture in pictures.items():
            write_image(folder / name, picture)
    progress(len(scene.chosen) + 1, len(scene.chosen) + 1)
    summary = {"cm_per_su": scale.cm_per_su, "error_pct": 100 * scale.relative_error, **evidence}
    unclear = "table" in together.agreeing and isinstance(scene.table, TableFit) and bool(scene.table.unclear_edges)
    return StageOutcome(summary, *_doubts(together, unclear))


def _check_points(workspace: Workspace, options: ScaleOptions) -> None:
    if not options.distance_cm:
        raise BadUsage("the distance of the two points is not given; add --distance-cm")
    if not workspace.scale_points.exists():
        raise MissingInput(
            f"{workspace.scale_points.name} is missing; name two points in it, with columns {', '.join(COLUMNS)}"
        )


def _load(workspace: Workspace, options: ScaleOptions, progress: Progress) -> _Scene:
    cameras = read_cameras(workspace.undistorted / "sparse")
    gaussians = read_gaussians(workspace.gaussians_ply)
    solid = gaussians.means[gaussians.opacities > 0.5]
    tracks = read_points(workspace.undistorted / "sparse")[0]
    points = np.concatenate([tracks, solid]).astype(np.float64)
    chosen = [cameras[i] for i in evenly_spaced(azimuths(cameras, fit_orbit(cameras)), VIEWS)]
    photos = []
    for number, camera in enumerate(chosen):
        progress(number, len(chosen) + 1, "photos of the table")
        photos.append(read_image(workspace.undistorted_image(camera.name)))
    aspect = options.table_length_cm / options.table_width_cm
    table = find_table(points, cameras, photos, chosen, tracks=tracks, aspect=aspect)
    ground = table.rectangle if isinstance(table, TableFit) else find_ground(points, cameras)
    return _Scene(workspace, cameras, points, chosen, photos, table, ground)


def _table(scene: _Scene, options: ScaleOptions) -> tuple[Reference | NoReference, Pictures]:
    if isinstance(scene.table, NoTable):
        return NoReference(scene.table.reason), {}
    scale = scale_from_table(scene.table, options.table_length_cm, options.table_width_cm)
    reference = Reference("table", scale.cm_per_su, scale.relative_error, _evidence(scene.table))
    return reference, _table_pictures(scene, scene.table.rectangle)


def _sections(scene: _Scene, options: ScaleOptions) -> tuple[Reference | NoReference, Pictures]:
    if scene.ground is None:
        return NoReference("no level plane is bounded like a table"), {}
    radius = fit_orbit(scene.cameras).radius
    sides = options.table_length_cm, options.table_width_cm
    return scale_from_sections(scene.points, scene.ground, *sides, radius), _table_pictures(scene, scene.ground)


def _aruco(scene: _Scene, options: ScaleOptions) -> tuple[Reference | NoReference, Pictures]:
    kind = MarkerKind(options.dictionary, options.marker_cm, board_squares(options.board))
    found = [find_markers(read_image(scene.workspace.undistorted_image(c.name)), kind) for c in scene.cameras]
    fit = scale_from_markers(scene.cameras, found, kind)
    if isinstance(fit, NoReference):
        return fit, {}
    shown = [outline_markers(photo, camera, fit.sightings) for camera, photo in scene.shown()]
    return fit.reference, {f"markers_{number}.jpg": picture for number, picture in enumerate(shown)}


def _distance(scene: _Scene, options: ScaleOptions) -> tuple[Reference | NoReference, Pictures]:
    picks = read_picks(scene.workspace.scale_points)
    found = scale_from_distance(scene.cameras, picks, options.distance_cm)
    if isinstance(found, NoReference):
        return found, {}
    reference, points = found
    shown = [draw_crosses(photo, camera, points) for camera, photo in scene.shown()]
    return reference, {f"points_{number}.jpg": picture for number, picture in enumerate(shown)}


_FIND = {"table": _table, "sections": _sections, "aruco": _aruco, "distance": _distance}
_TABLE_REMEDY = (
    "film so that all of the table top is seen, or give its size with --table-length-cm and --table-width-cm"
)
_REMEDY = {
    "table": _TABLE_REMEDY,
    "sections": _TABLE_REMEDY,
    "aruco": "lay printed markers (cotton3dg markers) of at least 10 cm flat beside the plant and give --marker-cm",
    "distance": "pick both points in more images of sfm/undistorted/images",
    "all": "film so that all of the table top is seen, or lay printed markers (cotton3dg markers) beside the plant",
}


def _table_pictures(scene: _Scene, rectangle: Rectangle) -> Pictures:
    return {
        f"table_{number}.jpg": outline_table(photo, camera, rectangle)
        for number, (camera, photo) in enumerate(scene.shown())
    }


def _doubts(together: Reconciled, unclear_edge: bool) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Flags and warnings of a scale."""
    flags, warnings = [], []
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


def _facts(references: list[Reference]) -> tuple[dict[str, Any], ...]:
    """Each reference for itself."""
    return tuple(
        {"source": item.source, "cm_per_su": item.cm_per_su, "relative_error": item.relative_error, **item.evidence}
        for item in references
    )


def _without(workspace: Workspace, options: ScaleOptions, reason: str, warnings: tuple[str, ...]) -> StageOutcome:
    """Say in scale.json that there is no scale, and why; the metric cells will stay blank."""
    if options.require_scale:
        raise NoScale(warnings[0] if warnings else f"{reason}; use --method table or drop --require-scale")
    with workspace.writing("scale") as folder:
        ScaleInfo(NO_SOURCE, reason).save(folder / workspace.scale_json.name)
    return StageOutcome({"source": NO_SOURCE}, ("no_scale",), warnings)


def _evidence(fit: TableFit) -> dict[str, Any]:
    evidence: dict[str, Any] = {"aspect": fit.aspect, "fill": fit.fill, "inliers": fit.inliers}
    if fit.rim:
        evidence["edge_residuals_px"] = list(fit.rim.residual_px)
        evidence["edge_support"] = list(fit.rim.support)
        evidence["edge_views"] = list(fit.rim.views)
    return evidence


STAGE = Stage("scale", version=5, inputs=inputs, run=run, cost=lambda work: Cost(0.0, 2.8))
