# SPDX-License-Identifier: Apache-2.0
"""The tables: one row for the plant, one for each boll."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from .. import __version__
from ..core.bolls import BollInstance
from ..core.columns import Column, cells_of
from ..core.map_measurements import BollMapTraits, MapTraits
from ..core.measurements import PlantEvidence, PlantFrame, PlantTraits, Scale, is_counted
from ..core.plant_map import PlantMap
from ..core.runs import Progress, StageOutcome, silent
from ..core.scene import Camera, Float64, Gaussians
from ..geometry.camera_orbit import fit_orbit
from ..io.colmap import read_cameras
from ..io.images import read_ids, read_image
from ..io.ply import read_gaussians
from ..io.saving import write_text_atomically
from ..io.skeleton import draw_map, skeleton_ply
from ..io.tables import BOLLS, BRANCHES, TRAITS, columns_text, csv_text
from ..options import TraitsOptions
from ..plant_map.edges import edge_opacity
from ..plant_map.map_plant import map_gaussians
from ..plant_map.summary import boll_rows, branch_rows, summarise_map
from ..plant_map.thin_twigs import Trail, follow_thin_twigs
from ..recorded_options import recorded
from ..schemas.bolls import BollsInfo, boll_labels, describe_bolls, read_bolls_of
from ..schemas.corrections import OF_BOLLS, Corrections
from ..schemas.masks import MasksInfo
from ..schemas.scale import PatchesInfo, ScaleInfo
from ..schemas.sfm import SfmInfo
from ..schemas.skeleton import describe_map
from ..schemas.train import Effects, TrainMetrics
from ..schemas.weights import WeightModel
from ..stage import FILE, STAGES, Cost, Stage, Work
from ..workspace import Workspace
from .corrections import Corrected, apply_corrections, still_left_out
from .error_model import Conditions
from .lint_colour import boll_colour, calibrate, mask_reflectance, plant_colour
from .measure import Measured, Parts, mark_corrections, measure_parts, measure_whole
from .plant_segmentation import Plant
from .plant_size import TIP_OPACITY
from .weight import predict_weight

NO_MAP: Final = "no_map"
UNMAPPED: Final = (
    "no stem can be followed up from the clamp, so there is no plant map; film so that the whole stem is seen"
)
EARLIER_STAGES: Final = tuple(stage for stage in STAGES if stage != "traits")


def inputs(workspace: Workspace) -> list[Path]:
    return [
        workspace.gaussians_ply,
        workspace.bolls_json,
        workspace.labels_npy,
        workspace.scale_json,
        workspace.metrics_json,
        workspace.effects_json,
        workspace.sfm_json,
        workspace.corrections_json,
        workspace.masks_json,
        workspace.undistorted,
        workspace.patches_json,
        *([workspace.folder("masks"), workspace.boll_images] if workspace.patches_json.exists() else []),
        *(workspace.record_file(stage) for stage in EARLIER_STAGES),
    ]


def run(workspace: Workspace, options: TraitsOptions, progress: Progress = silent) -> StageOutcome:
    """Writes traits.csv, bolls.csv, branches.csv, columns.csv (what each column means), skeleton.json, skeleton.ply and
    plant_map.svg (the plant's map), and plant.npy (rows of the plant)."""
    gaussians = read_gaussians(workspace.require(workspace.gaussians_ply, "train"))
    labels_npy = workspace.require(workspace.labels_npy, "cluster")
    bolls = read_bolls_of(gaussians, workspace.require(workspace.bolls_json, "cluster"), labels_npy)
    scale_info = ScaleInfo.load(workspace.require(workspace.scale_json, "scale"))
    scale, metrics = scale_info.scale, TrainMetrics.load(workspace.require(workspace.metrics_json, "train"))
    measured, corrected, plant_map = _measure(workspace, options, gaussians, bolls, scale_info, metrics.pixel_su)
    map_traits = _summarised(plant_map, scale, metrics.pixel_su, options.tube_height_cm)
    unmapped = measured.plant is not None and not plant_map.axes
    of_plant = measured.plant.rows if measured.plant else np.zeros(len(gaussians), bool)
    flags = (*measured.flags, *([NO_MAP] if unmapped else []))
    warnings = (*measured.warnings, *([UNMAPPED] if unmapped else []))
    if weights := STAGE.named_files(workspace, options):
        measured = replace(measured, traits=_weighed(measured.traits, WeightModel.load(weights[0])))
    evidence = _evidence(workspace, scale, metrics, flags)
    plant_id = options.plant_id or workspace.plant_id
    colours = _lint_colours(workspace, corrected.bolls if corrected else bolls)
    tables = _tables(workspace, plant_id, measured, evidence, plant_map, map_traits, colours)
    with workspace.writing("traits") as folder:
        for name, (columns, rows) in tables.items():
            write_text_atomically(folder / name, csv_text(columns, rows, excel=options.excel))
        meanings = columns_text({name: columns for name, (columns, _) in tables.items()}, excel=options.excel)
        write_text_atomically(folder / workspace.columns_csv.name, meanings)
        describe_map(plant_map).save(folder / workspace.skeleton_json.name)
        write_text_atomically(folder / workspace.skeleton_ply.name, skeleton_ply(plant_map))
        if plant_map.axes:
            write_text_atomically(folder / workspace.plant_map_svg.name, draw_map(plant_map, plant_id))
        np.save(folder / workspace.plant_npy.name, of_plant)
        if corrected:
            describe_bolls(corrected.bolls, gaussians.sha256()).save(folder / workspace.corrected_bolls_json.name)
            labels = boll_labels(corrected.bolls, len(gaussians))
            np.save(folder / workspace.corrected_labels_npy.name, labels)
    keys = ("boll_count", "boll_volume_cm3", "plant_height_cm", "canopy_size_cm")
    summary = {key: getattr(measured.traits, key) for key in keys} | {"branch_count": map_traits.branch_count}
    return StageOutcome(summary, flags, warnings)


def _measure(
    workspace: Workspace,
    options: TraitsOptions,
    gaussians: Gaussians,
    bolls: list[BollInstance],
    scale_info: ScaleInfo,
    pixel_su: float,
) -> tuple[Measured, Corrected | None, PlantMap]:
    """The measures, a person's corrections, and the map, with the twigs that only the photos show."""
    scale, found = scale_info.scale, (scale_info.found or scale_info).scale
    if masks := MasksInfo.load_if_there(workspace.masks_json):
        recorded("masks", {"backend": masks.backend})  # refuses those of a back end that is gone
    by_images = BollsInfo.load(workspace.bolls_json)
    cameras = _cameras(workspace)
    conditions = _conditions(workspace, cameras, by_images.joining)

    def parts_of(some: list[BollInstance], by: Scale | None, added: Collection[int] = ()) -> Parts:
        return measure_parts(gaussians, some, by, pixel_su, options.tube_height_cm, cameras, conditions, added)

    last = before = parts_of(bolls, found)
    corrected = _corrected(workspace, gaussians, bolls, found, before.plant)
    if corrected or scale_info.found:
        corrected = corrected or Corrected(bolls)
        last = parts_of(corrected.bolls, scale, corrected.added)
    plant_map, plant = _map(gaussians, last, cameras), last.plant
    ends: list[Float64] = []
    if scale and plant and (trails := _thin_twigs(workspace, gaussians, plant, scale, cameras, plant_map)):
        plant_map = _map(gaussians, last, cameras, [trail.places for trail in trails])
        ends = [PlantFrame(scale, plant.foot).scene(trail.places) for trail in trails if not trail.meets_model]
    measured = measure_whole(before, by_images.halves, ends, by_images.left_out)
    if corrected:
        again = measure_whole(last, None, ends, still_left_out(by_images.left_out, corrected.bolls))
        measured = mark_corrections(measured, again, corrected, scale_info.moved_corners)
    return measured, corrected, plant_map


def _tables(
    workspace: Workspace,
    plant_id: str,
    measured: Measured,
    evidence: PlantEvidence,
    plant_map: PlantMap,
    map_traits: MapTraits,
    colours: dict[int, list[Float64]],
) -> dict[str, tuple[Sequence[Column], list[dict[str, Any]]]]:
    """File -> its columns and rows.

    Args:
        colours: boll -> mean reflectances of its lint.
    """
    whose, sites = {"plant_id": plant_id}, boll_rows(plant_map)
    counted = [boll.boll_id for boll in measured.bolls if is_counted(boll.flags)]
    lint = plant_colour(colours[boll_id] for boll_id in counted if boll_id in colours)
    of_plant = cells_of(measured.traits, evidence, map_traits, lint)
    of_bolls = [
        cells_of(boll, sites.get(boll.boll_id, BollMapTraits()), boll_colour(colours.get(boll.boll_id, [])))
        for boll in measured.bolls
    ]
    of_branches = [cells_of(branch) for branch in branch_rows(plant_map)]
    return {
        workspace.traits_csv.name: (TRAITS, [whose | of_plant]),
        workspace.bolls_csv.name: (BOLLS, [whose | cells for cells in of_bolls]),
        workspace.branches_csv.name: (BRANCHES, [whose | cells for cells in of_branches]),
    }


def _corrected(
    workspace: Workspace, gaussians: Gaussians, bolls: list[BollInstance], scale: Scale | None, plant: Plant | None
) -> Corrected | None:
    """The bolls after a person's corrections; None without any.

    Args:
        scale: as it was found; places in corrections refer to it. plant: by this scale.
    """
    corrections = Corrections.load_if_there(workspace.corrections_json)
    if not corrections or not corrections.of(*OF_BOLLS):
        return None
    frame = PlantFrame(scale, plant.foot) if scale and plant else None
    return apply_corrections(bolls, corrections.of(*OF_BOLLS), gaussians, gaussians.sha256(), frame)


def _lint_colours(workspace: Workspace, bolls: list[BollInstance]) -> dict[int, list[Float64]]:
    """Mean reflectance of each boll in each photo that shows it and the card's patches; none without a card."""
    found: dict[int, list[Float64]] = {boll.boll_id: [] for boll in bolls}
    patches = PatchesInfo.load_if_there(workspace.patches_json)
    if patches is None:
        return found
    for view, levels in sorted(patches.views.items()):
        calibration = calibrate(np.array(levels), patches.reflectances)
        shown = {boll.boll_id: [mask_id for name, mask_id in boll.masks if name == view] for boll in bolls}
        if calibration is None or not any(shown.values()):
            continue
        photo, ids = read_image(workspace.undistorted_image(view)), read_ids(workspace.boll_ids_png(view))
        for boll_id, mask_ids in shown.items():
            colour = mask_reflectance(photo, np.isin(ids, mask_ids), calibration)
            if colour is not None:
                found[boll_id].append(colour)
    return found


def _map(gaussians: Gaussians, parts: Parts, cameras: list[Camera], trails: Sequence[Float64] = ()) -> PlantMap:
    """The map of the plant; empty without a plant or a stem."""
    scale, plant = parts.scale, parts.plant
    if scale is None or plant is None:
        return PlantMap((), (), "no_scale" if scale is None else "no_plant")
    of_wood = plant.rows & ~parts.boll_rows
    wood = gaussians[of_wood]
    bolls = [(boll.boll_id, boll.centre_cm, boll.diameter_cm) for boll in parts.bolls]
    opaque = edge_opacity(wood, gaussians[~plant.rows], cameras)
    return map_gaussians(wood, parts.drawn[of_wood], scale, plant.foot, bolls, opaque, trails)


def _thin_twigs(
    workspace: Workspace, gaussians: Gaussians, plant: Plant, scale: Scale, cameras: list[Camera], plant_map: PlantMap
) -> list[Trail]:
    """Twigs that go on in the photos where they end in the model; none for a model that came without its photos."""
    photos = {camera.name: workspace.undistorted_image(camera.name) for camera in cameras}
    if not all(photo.exists() for photo in photos.values()):
        return []
    opaque = gaussians[plant.rows & (gaussians.opacities > TIP_OPACITY)]
    return follow_thin_twigs(plant_map, opaque, scale, plant.foot, cameras, lambda name: read_image(photos[name]))


def _summarised(plant_map: PlantMap, scale: Scale | None, pixel_su: float, clamp_cm: float) -> MapTraits:
    if scale is None:
        return MapTraits()
    return summarise_map(plant_map, clamp_cm, scale.relative_error, pixel_su * scale.cm_per_su)


def _weighed(traits: PlantTraits, model: WeightModel) -> PlantTraits:
    """The traits with the weight that a fit predicts."""
    weight = predict_weight(model, cells_of(traits))
    return replace(
        traits,
        seed_cotton_g=weight.seed_cotton_g,
        seed_cotton_low_g=weight.low_g,
        seed_cotton_high_g=weight.high_g,
        lint_g=weight.lint_g,
    )


def _conditions(workspace: Workspace, cameras: list[Camera], joining: float) -> Conditions:
    """Motion blur as the trainer found it, and the gap of the walk: neither for a model that came without images."""
    effects = Effects.load_if_there(workspace.effects_json)
    found = effects.motion_blur if effects else None
    blur_px = found.median_px if found and found.found else 0.0
    return Conditions(blur_px, fit_orbit(cameras).largest_gap_deg if cameras else 0.0, joining=joining)


def _cameras(workspace: Workspace) -> list[Camera]:
    """The cameras of the plant's images; none for a model that came without images."""
    sparse = workspace.undistorted / "sparse"
    return read_cameras(sparse) if sparse.is_dir() else []


def _evidence(
    workspace: Workspace, scale: Scale | None, metrics: TrainMetrics, flags: tuple[str, ...]
) -> PlantEvidence:
    """The facts about capture and cost from earlier stages, None where one is missing; `flags` are added to theirs."""
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
    # Bolls' bodies and the search for thin twigs take all cores.
    return Cost(3.0 + 12 * work.million_gaussians, 4.0 + 16 * work.million_gaussians)


STAGE: Final = Stage("traits", version=37, inputs=inputs, run=run, cost=_cost, names={"weight_model": FILE})
