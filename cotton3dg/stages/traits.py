"""The tables: one row for the plant, one for each boll."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .. import __version__
from ..core.columns import cells_of
from ..core.measurements import PlantEvidence, Scale
from ..core.outcome import StageOutcome
from ..core.progress import Progress, silent
from ..documents.bolls import read_bolls
from ..documents.record import Record
from ..documents.scale import read_scale
from ..documents.sfm import SfmInfo
from ..documents.train import TrainMetrics
from ..errors import BadInput
from ..files.ply import read_gaussians
from ..files.tables import BOLLS, TRAITS, columns_text, csv_text
from ..options import TraitsOptions
from ..traits.isolate import isolate_plant
from ..traits.measure import measure_bolls, measure_silhouette, summarise_plant
from ..traits.surface import as_drawn
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
    flags, warnings = [], []
    plant = None
    if scale is not None:
        boll_rows = np.zeros(len(gaussians), bool)
        for boll in bolls:
            boll_rows[boll.indices] = True
        plant = isolate_plant(gaussians, scale, options.tube_height_cm, boll_rows)
        if plant is None:
            flags.append("no_plant")
            warnings.append("nothing stands on the table; look at train/gaussians.ply and at scale/table_0.jpg")
        elif not plant.stem_found:
            flags.append("no_stem")
            warnings.append("no stem rises from the clamp, so the plant's origin is a guess; film closer to its foot")
    metrics = TrainMetrics.load(workspace.require(workspace.metrics_json, "train"))
    drawn = as_drawn(gaussians, metrics.pixel_su)
    foot = plant.foot if plant else None
    boll_traits = measure_bolls(drawn, bolls, scale, foot, metrics.pixel_su, options.tube_height_cm)
    silhouette = measure_silhouette(drawn, plant, scale) if plant and scale else None
    traits = summarise_plant(boll_traits, silhouette, scale, metrics.pixel_su)
    flags += traits.flags
    plant_id = options.plant_id or workspace.plant_id
    records = [record for record in map(workspace.read_record, EARLIER_STAGES) if record]
    all_flags = _united([*(flag for record in records for flag in record.flags), *flags])
    whose = {"plant_id": plant_id}
    row = whose | cells_of(traits, _evidence(workspace, scale, metrics, records, all_flags))
    boll_cells = [whose | cells_of(boll) for boll in boll_traits]
    tables = {workspace.traits_csv.name: (TRAITS, [row]), workspace.bolls_csv.name: (BOLLS, boll_cells)}
    with workspace.writing("traits") as folder:
        for name, (columns, rows) in tables.items():
            _write_csv(folder / name, csv_text(columns, rows, excel=options.excel))
        meanings = columns_text({name: columns for name, (columns, _) in tables.items()}, excel=options.excel)
        _write_csv(folder / workspace.columns_csv.name, meanings)
        np.save(folder / workspace.plant_npy.name, plant.rows if plant else np.zeros(len(gaussians), bool))
    summary = {
        "boll_count": traits.boll_count,
        "boll_volume_cm3": traits.boll_volume_cm3,
        "plant_height_cm": traits.plant_height_cm,
        "canopy_size_cm": traits.canopy_size_cm,
    }
    return StageOutcome(summary, tuple(flags), tuple(warnings))


def _evidence(
    workspace: Workspace,
    scale: Scale | None,
    metrics: TrainMetrics,
    records: list[Record],
    flags: tuple[str, ...],
) -> PlantEvidence:
    """What earlier stages say about capture and cost; None where they do not."""
    sfm = SfmInfo.load_if_there(workspace.sfm_json)
    return PlantEvidence(
        scale_source=scale.source if scale else "none",
        scale_error_pct=100 * scale.relative_error if scale else None,
        n_frames=sfm.n_frames if sfm else None,
        registered_pct=100.0 * len(sfm.registered) / sfm.n_frames if sfm else None,
        psnr_db=metrics.psnr_db,
        seconds=float(sum(record.seconds for record in records)),
        flags=flags,
        version=__version__,
    )


def _united(flags: list[str]) -> tuple[str, ...]:
    """Each flag once, in order of its first appearance."""
    return tuple(dict.fromkeys(flags))


def _write_csv(path: Path, text: str) -> None:
    # In binary: the text has its own line ends.
    path.write_bytes(text.encode("utf-8"))


def _cost(work: Work) -> Cost:
    return Cost(0.0, 1.5 + 28 * work.million_gaussians)


STAGE = Stage("traits", version=6, inputs=inputs, run=run, cost=_cost)
