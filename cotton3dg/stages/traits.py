"""The tables: one row for the plant, one for each boll."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .. import __version__
from ..core.columns import cells_of
from ..core.measurements import PlantEvidence, Scale
from ..core.outcome import StageOutcome
from ..core.progress import Progress, silent
from ..core.scene import Camera
from ..documents.bolls import read_bolls
from ..documents.scale import read_scale
from ..documents.sfm import SfmInfo
from ..documents.train import TrainMetrics
from ..errors import BadInput
from ..files.colmap import read_cameras
from ..files.ply import read_gaussians
from ..files.saving import write_text_atomically
from ..files.tables import BOLLS, TRAITS, columns_text, csv_text
from ..options import TraitsOptions
from ..traits.measure import measure_plant
from ..traits.whole_in_view import doubt_whole
from ..workspace import Workspace
from .stage import STAGES, Cost, Stage, Work

EARLIER_STAGES = tuple(stage for stage in STAGES if stage != "traits")


def inputs(workspace: Workspace) -> list[Path]:
    return [
        workspace.gaussians_ply,
        workspace.bolls_json,
        workspace.labels_npy,
        workspace.scale_json,
        workspace.metrics_json,
        workspace.sfm_json,
        workspace.undistorted / "sparse",
        *(workspace.record_file(stage) for stage in EARLIER_STAGES),
    ]


def run(workspace: Workspace, options: TraitsOptions, progress: Progress = silent) -> StageOutcome:
    """Writes traits.csv, bolls.csv, columns.csv (what each column means) and plant.npy (rows of the plant)."""
    gaussians = read_gaussians(workspace.require(workspace.gaussians_ply, "train"))
    labels_npy = workspace.require(workspace.labels_npy, "cluster")
    bolls, sha256 = read_bolls(workspace.require(workspace.bolls_json, "cluster"), labels_npy)
    if sha256 != gaussians.sha256():
        raise BadInput("bolls.json belongs to another model than gaussians.ply; run `cotton3dg cluster` again")
    scale = read_scale(workspace.require(workspace.scale_json, "scale"))
    metrics = TrainMetrics.load(workspace.require(workspace.metrics_json, "train"))
    measured = measure_plant(gaussians, bolls, scale, metrics.pixel_su, options.tube_height_cm)
    of_plant = measured.plant.rows if measured.plant else np.zeros(len(gaussians), bool)
    cut_flags, cut_warnings = doubt_whole(gaussians.means[of_plant], _cameras(workspace))
    flags, warnings = (*measured.flags, *cut_flags), (*measured.warnings, *cut_warnings)
    evidence = _evidence(workspace, scale, metrics, flags)
    whose = {"plant_id": options.plant_id or workspace.plant_id}
    tables = {
        workspace.traits_csv.name: (TRAITS, [whose | cells_of(measured.traits, evidence)]),
        workspace.bolls_csv.name: (BOLLS, [whose | cells_of(boll) for boll in measured.bolls]),
    }
    with workspace.writing("traits") as folder:
        for name, (columns, rows) in tables.items():
            write_text_atomically(folder / name, csv_text(columns, rows, excel=options.excel))
        meanings = columns_text({name: columns for name, (columns, _) in tables.items()}, excel=options.excel)
        write_text_atomically(folder / workspace.columns_csv.name, meanings)
        np.save(folder / workspace.plant_npy.name, of_plant)
    keys = ("boll_count", "boll_volume_cm3", "plant_height_cm", "canopy_size_cm")
    return StageOutcome({key: getattr(measured.traits, key) for key in keys}, flags, warnings)


def _cameras(workspace: Workspace) -> list[Camera]:
    """Those of the plant's images; none of a model that came without."""
    sparse = workspace.undistorted / "sparse"
    return read_cameras(sparse) if sparse.is_dir() else []


def _evidence(
    workspace: Workspace, scale: Scale | None, metrics: TrainMetrics, flags: tuple[str, ...]
) -> PlantEvidence:
    """What earlier stages say about capture and cost, None where they do not; `flags` are added to theirs."""
    sfm = SfmInfo.load_if_there(workspace.sfm_json)
    records = [record for record in map(workspace.read_record, EARLIER_STAGES) if record]
    return PlantEvidence(
        scale_source=scale.source if scale else "none",
        scale_error_pct=100 * scale.relative_error if scale else None,
        n_frames=sfm.n_frames if sfm else None,
        registered_pct=100.0 * len(sfm.registered) / sfm.n_frames if sfm else None,
        psnr_db=metrics.psnr_db,
        seconds=float(sum(record.seconds for record in records)),
        # Each once, in order of its first appearance.
        flags=tuple(dict.fromkeys([*(flag for record in records for flag in record.flags), *flags])),
        version=__version__,
    )


def _cost(work: Work) -> Cost:
    return Cost(0.0, 1.5 + 28 * work.million_gaussians)


STAGE = Stage("traits", version=7, inputs=inputs, run=run, cost=_cost)
