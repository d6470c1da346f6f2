# SPDX-License-Identifier: Apache-2.0
"""Finds the metric scale and the up axis by things of known size."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.card import PATCH_LEVELS, printed_reflectance
from ..core.runs import Progress, StageOutcome, silent
from ..errors import BadInput, BadUsage, MissingInput, NoScale
from ..io.colmap import read_cameras, read_points
from ..io.images import read_image, write_image
from ..io.picks import COLUMNS, read_picks
from ..io.ply import read_gaussians
from ..io.saving import file_sha256
from ..options import ScaleOptions
from ..schemas.corrections import CORNER, Correction, Corrections
from ..schemas.scale import PatchesInfo
from ..stage import Cost, Stage
from ..workspace import Workspace
from .corners import move_corners, refuse_moves
from .estimate_scale import FoundScale, Plant, estimate_scale, no_scale


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted, workspace.gaussians_ply, workspace.scale_points]


def parts(workspace: Workspace, _: ScaleOptions) -> dict[str, str]:
    """The corrections of the table. Other corrections do not change the scale."""
    if not workspace.corrections_json.exists():
        return {}
    name = f"{workspace.corrections_json.name}#{CORNER}"
    try:
        moves = Corrections.load(workspace.corrections_json).of(CORNER)
    except BadInput:  # the stage reports it when it runs
        return {name: file_sha256(workspace.corrections_json)}
    return {name: hashlib.sha256(repr(moves).encode()).hexdigest()} if moves else {}


def run(workspace: Workspace, options: ScaleOptions, progress: Progress = silent) -> StageOutcome:
    """Writes scale.json and photos that show the reference: table_<n>.jpg, sections.jpg, markers_<n>.jpg,
    points_<n>.jpg, corners_<n>.jpg; where a card was searched and found, patches.json.

    Raises:
        BadUsage: the reflectances are not valid.
        NoScale: no reference was found although `require_scale` is set.
    """
    workspace.require(workspace.undistorted / "sparse", "sfm")
    workspace.require(workspace.gaussians_ply, "train")
    reflectances = _reflectances(options.card.patches)
    corrections = Corrections.load_if_there(workspace.corrections_json)
    moved = corrections.of(CORNER) if corrections else ()
    if options.method == "none":
        found = refuse_moves(no_scale("no reference was asked for"), ["no scale was asked for"] * len(moved))
    else:
        gaussians = read_gaussians(workspace.gaussians_ply)
        tracks = read_points(workspace.undistorted / "sparse")[0]
        solid = gaussians.means[gaussians.opacities > 0.5]
        plant = load_plant(workspace, options, workspace.undistorted, tracks, solid)
        found = estimate_scale(plant, options, progress)
        found = _moved(workspace, found, plant, options, moved) if moved else found
    if options.require_scale and found.info.scale is None:
        warnings = (*found.outcome.warnings, f"{found.info.reason}; use --method table or drop --require-scale")
        raise NoScale(warnings[0])
    with workspace.writing("scale") as folder:
        found.info.save(folder / workspace.scale_json.name)
        if found.patches:
            views = {name: tuple(map(tuple, levels.tolist())) for name, levels in found.patches.items()}
            PatchesInfo(reflectances, views).save(folder / workspace.patches_json.name)
        for name, picture in found.pictures.items():
            write_image(folder / name, picture)
    return found.outcome


def _reflectances(text: str) -> tuple[float, ...]:
    """Reflectances of the card's patches from white to black, 0..1: those of `text`, in per cent, or of a usual print.

    Raises:
        BadUsage: not as many falling numbers as there are patches.
    """
    if not text:
        return tuple(printed_reflectance(np.array(PATCH_LEVELS)).tolist())
    try:
        measured = [float(word) / 100 for word in text.split(",")]
    except ValueError:
        measured = []
    if len(measured) != len(PATCH_LEVELS) or not (np.diff([1.2, *measured, 0]) < 0).all():
        raise BadUsage(f"--patches {text!r}: write {len(PATCH_LEVELS)} falling reflectances in %, e.g. 86,53,29,14,6,4")
    return tuple(measured)


def _moved(
    workspace: Workspace, found: FoundScale, plant: Plant, options: ScaleOptions, corrections: tuple[Correction, ...]
) -> FoundScale:
    """The scale with the corners that a person moved, if the photos are still those with the picks."""
    placed = {camera.name for camera in plant.cameras}
    moves, refused = [], []
    for correction in corrections:
        known = {pick.image for pick in correction.picks} <= placed and workspace.has_images(correction.picks)
        if correction.problem() or not known:
            refused.append(correction.problem() or "a photo that was pointed at is another one now")
            continue
        moves.append({pick.image: np.array([pick.x_px, pick.y_px]) for pick in correction.picks})
    return move_corners(found, plant, moves, options, refused)


def load_plant(
    workspace: Workspace, options: ScaleOptions, undistorted: Path, tracks: NDArray[np.float64], solid: NDArray[Any]
) -> Plant:
    """The scene and photos in which references are searched.

    Args:
        undistorted: folder with `images/` and the COLMAP model `sparse/`.
        tracks: (T, 3) su, triangulated points.
        solid: (S, 3) su, means of the opaque Gaussians; none without a model.
    """
    has_points = workspace.scale_points.exists()
    if options.method == "distance" or (options.method == "all" and has_points):
        if not options.distance.distance_cm:
            raise BadUsage("the distance of the two points is not given; add --distance-cm")
        if not has_points:
            raise MissingInput(
                f"{workspace.scale_points.name} is missing; name two points in it, with columns {', '.join(COLUMNS)}"
            )
        picks = read_picks(workspace.scale_points)
    else:
        picks = None
    return Plant(
        read_cameras(undistorted / "sparse"),
        photo=lambda name: read_image(undistorted / "images" / name),
        tracks=tracks,
        solid=solid,
        picks=picks,
    )


STAGE: Final = Stage("scale", version=11, inputs=inputs, run=run, cost=lambda work: Cost(0.0, 2.8), parts=parts)
