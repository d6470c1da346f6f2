"""Metric scale and up axis from the table of known size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..core.outcome import StageOutcome
from ..core.progress import Progress, silent
from ..errors import NoScale
from ..files.colmap import read_cameras, read_points
from ..files.images import read_image, write_image
from ..files.ply import read_gaussians
from ..files.scale import scale_facts
from ..options import ScaleOptions
from ..plant.table import NoTable, TableFit, find_table, outlined, scale_from_table
from ..plant.views import azimuths, evenly_spaced, fit_orbit
from ..workspace import Workspace, json_text

VERSION = 2
VIEWS = 40
"""Photos in which the rim of the table is measured."""
PICTURES = 3


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted, workspace.gaussians_ply]


def run(workspace: Workspace, options: ScaleOptions, progress: Progress = silent) -> StageOutcome:
    """Writes scale.json and, where there is a table, table_<n>.jpg: photos with its outline.

    Raises:
        NoScale: no table was found although `require_scale` is set.
    """
    model = workspace.require(workspace.undistorted / "sparse", "sfm")
    gaussians_ply = workspace.require(workspace.gaussians_ply, "train")
    if options.method == "none":
        return _without(workspace, options, "no reference was asked for", ())
    cameras = read_cameras(model)
    gaussians = read_gaussians(gaussians_ply)
    solid = gaussians.means[gaussians.opacities > 0.5]
    points = np.concatenate([read_points(model)[0], solid])
    chosen = [cameras[i] for i in evenly_spaced(azimuths(cameras, fit_orbit(cameras)), VIEWS)]
    images = []
    for number, camera in enumerate(chosen):
        progress(number, len(chosen) + 1, "photos of the table")
        images.append(read_image(workspace.undistorted_image(camera.name)))
    progress(len(chosen), len(chosen) + 1, "edges of the table")
    aspect = options.table_length_cm / options.table_width_cm
    fit = find_table(points, cameras, images, chosen, aspect=aspect)
    if isinstance(fit, NoTable):
        remedy = (
            "film so that all of the table top is seen, or give its size with --table-length-cm and --table-width-cm"
        )
        return _without(workspace, options, fit.reason, (f"no table of known size was found ({fit.reason}); {remedy}",))
    scale = scale_from_table(fit, options.table_length_cm, options.table_width_cm)
    with workspace.writing("scale") as folder:
        (folder / workspace.scale_json.name).write_text(
            json_text(scale_facts(scale) | {"evidence": _evidence(fit)}), encoding="utf-8"
        )
        for number in range(PICTURES):
            index = number * len(chosen) // PICTURES
            write_image(folder / f"table_{number}.jpg", outlined(images[index], chosen[index], fit.rectangle))
    progress(len(chosen) + 1, len(chosen) + 1)
    summary = {"cm_per_su": scale.cm_per_su, "error_pct": 100 * scale.relative_error, **_evidence(fit)}
    if scale.relative_error > 0.01:
        warning = f"the sides of the table disagree by {200 * scale.relative_error:.1f} %; check the table's size"
        return StageOutcome(summary, ("scale_uncertain",), (warning,))
    return StageOutcome(summary)


def _without(workspace: Workspace, options: ScaleOptions, reason: str, warnings: tuple[str, ...]) -> StageOutcome:
    """Say in scale.json that there is no scale, and why; the metric cells will stay blank."""
    if options.require_scale:
        raise NoScale(warnings[0] if warnings else f"{reason}; use --method table or drop --require-scale")
    with workspace.writing("scale") as folder:
        facts = {"source": "none", "reason": reason}
        (folder / workspace.scale_json.name).write_text(json_text(facts), encoding="utf-8")
    return StageOutcome({"source": "none"}, ("no_scale",), warnings)


def _evidence(fit: TableFit) -> dict[str, Any]:
    evidence: dict[str, Any] = {"aspect": fit.aspect, "fill": fit.fill, "inliers": fit.inliers}
    if fit.rim:
        evidence["edge_residuals_px"] = list(fit.rim.residual_px)
        evidence["edge_support"] = list(fit.rim.support)
        evidence["edge_views"] = list(fit.rim.views)
    return evidence
