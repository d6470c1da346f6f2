# SPDX-License-Identifier: Apache-2.0
"""The traits of a plant and of its bolls, from their Gaussians."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import BollInstance, LeftOut
from ..core.measurements import BollTraits, PlantFrame, PlantTraits, Scale, is_counted
from ..core.scene import Camera, Float64, Gaussians
from .boll_volume import measure_bolls
from .corrections import Corrected
from .count_distribution import Moments, Possible, distribute_count, miscounted_volume
from .error_model import (
    AS_IF_NEAR,
    CROWDED_SHARE,
    UNROUND_FLAG,
    USUAL_CONDITIONS,
    Conditions,
    blurs_bolls,
    find_touching,
    halves_disagree,
    interval,
    nearest_neighbours,
    plant_volume_error_cm3,
    size_error_cm,
)
from .plant_segmentation import Plant, isolate_plant
from .plant_size import PlantSize, Sized, size_plant
from .surface import dilate_gaussians
from .truncation import check_truncation

MAY_LACK: Final = 0.25
"""The plant has a flag if the expected number of bolls among the things left out is at least this."""
DOUBTFUL_SHARE: Final = 0.1
"""The plant has a flag if at least this share of its bolls has flags."""


@dataclass(frozen=True)
class Measured:
    """A plant with its traits, flags and warnings."""

    plant: Plant | None
    """None without a scale, or where nothing stands on the table."""
    bolls: list[BollTraits]
    traits: PlantTraits
    flags: tuple[str, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Parts:
    """A plant and its bolls, before its size is measured."""

    plant: Plant | None
    """None without a scale, or where nothing stands on the table."""
    bolls: list[BollTraits]
    boll_rows: NDArray[np.bool_]
    """(N,) Gaussians of bolls."""
    drawn: Gaussians
    """All Gaussians, as wide as they are drawn."""
    scale: Scale | None
    pixel_su: float
    clamp_cm: float
    conditions: Conditions
    concerns: dict[str, str]
    """Flag -> warning, of the plant as a whole."""


def measure_parts(
    gaussians: Gaussians,
    bolls: Sequence[BollInstance],
    scale: Scale | None,
    pixel_su: float,
    clamp_cm: float,
    cameras: Sequence[Camera] = (),
    conditions: Conditions = USUAL_CONDITIONS,
    added: Collection[int] = (),
) -> Parts:
    """The plant among the Gaussians, and its bolls.

    Args:
        pixel_su: width of a pixel of the training images at the plant.
        clamp_cm: height of the clamp that holds the plant.
        cameras: of the images, to decide whether they show the plant whole; none for a model that came without images.
        conditions: of the plant, for the errors; this function sets its `whole`.
        added: ids of bolls that a person added; they belong to the plant wherever they are.
    """
    concerns: dict[str, str] = {}
    plant = None
    boll_of = np.zeros(len(gaussians), np.int64)
    for boll in bolls:
        boll_of[boll.indices] = boll.boll_id
    if scale is not None:
        plant = isolate_plant(gaussians, scale, clamp_cm, boll_of)
        if plant is None:
            concerns["no_plant"] = "nothing stands on the table; look at train/gaussians.ply and at scale/table_0.jpg"
        elif not plant.stem_found:
            concerns["no_stem"] = (
                "no stem rises from the clamp, so the plant's origin is a guess; film closer to its foot"
            )
    cut, lost = check_truncation(gaussians.means[plant.rows], cameras) if plant else ("", False)
    conditions = replace(conditions, whole=not lost)
    if cut:
        concerns["plant_cut"] = cut
    drawn = dilate_gaussians(gaussians, pixel_su)
    apart = {boll.boll_id for boll in bolls if plant and plant.apart[boll.indices].mean() > 0.5} - {*added}
    if apart:
        concerns["bolls_off_plant"] = (
            f"boll {', '.join(map(str, sorted(apart)))} hangs on nothing that hangs together with the stem and is not"
            " counted; if it is a boll of this plant, delete it and add it again (cotton3dg correct)"
        )
    boll_traits = measure_bolls(
        drawn, bolls, scale, plant.foot if plant else None, pixel_su, clamp_cm, apart, conditions
    )
    return Parts(plant, boll_traits, boll_of > 0, drawn, scale, pixel_su, clamp_cm, conditions, concerns)


def measure_whole(
    parts: Parts,
    halves: tuple[int, int] | None = None,
    thin_ends: Sequence[Float64] = (),
    left_out: Sequence[LeftOut] = (),
) -> Measured:
    """The plant's size, and its row.

    Args:
        halves: counts of bolls by either half of the images, where they are known.
        thin_ends: (K, 3) su each, places of twigs that the photos show and the model lacks.
        left_out: what may be further bolls.
    """
    plant, scale, conditions = parts.plant, parts.scale, parts.conditions
    sized = Sized()
    if plant and scale and conditions.whole:
        sized = size_plant(parts.drawn, plant, scale, parts.clamp_cm, thin_ends)
    concerns = parts.concerns | sized.concerns
    if halves and halves_disagree(halves):
        concerns["halves_disagree"] = (
            f"every second image alone shows {halves[0]} bolls, the others {halves[1]}; look at the numbered bolls"
        )
    diameters_cm = np.array([boll.diameter_cm for boll in parts.bolls if is_counted(boll.flags)])
    if scale and blurs_bolls(conditions.blur_px, parts.pixel_su * scale.cm_per_su, diameters_cm):
        concerns["blurred"] = (
            f"motion blurs the images by {conditions.blur_px:.0f} px, much of a boll's width, so that bolls swell and"
            " merge; walk more slowly, or film with more light"
        )
    if sum(thing.probability for thing in left_out) >= MAY_LACK:
        where = "; ".join(_describe(thing, scale, plant) for thing in left_out)
        concerns["bolls_left_out"] = (
            f"not counted, though each may be a boll: {where}; if one is, add it (cotton3dg correct)"
        )
    traits = summarise_plant(parts.bolls, sized.size, scale, parts.pixel_su, halves, sized.other, conditions, left_out)
    return Measured(plant, parts.bolls, traits, (*concerns, *traits.flags), tuple(concerns.values()))


def mark_corrections(before: Measured, after: Measured, corrected: Corrected, moved_corners: int = 0) -> Measured:
    """The measures after the corrections, with the changes in columns of their own.

    Args:
        moved_corners: number of the table's corners that were moved, which changes the scale of all bolls.
    """
    volumes = {boll.boll_id: boll.volume_cm3 for boll in before.bolls}

    def marked(boll: BollTraits) -> BollTraits:
        change = corrected.words.get(boll.boll_id, "rescaled" if moved_corners else "")
        if not change:
            return boll
        was = corrected.origins.get(boll.boll_id, (boll.boll_id,))
        volume = sum(volumes[boll_id] for boll_id in was) if was else np.nan
        return replace(boll, corrected=change, original_bolls="+".join(map(str, was)), original_volume_cm3=volume)

    traits = replace(
        after.traits,
        corrections=corrected.applied + moved_corners,
        original_boll_count=before.traits.boll_count,
        original_boll_volume_cm3=before.traits.boll_volume_cm3,
        original_plant_height_cm=before.traits.plant_height_cm,
        original_canopy_size_cm=before.traits.canopy_size_cm,
    )
    flags, warnings = after.flags, after.warnings
    if corrected.refused:
        flags += ("corrections_not_applied",)
        warnings += tuple(f"correction not applied: {reason}" for reason in corrected.refused)
    bolls = [marked(boll) for boll in after.bolls]
    return replace(after, bolls=bolls, traits=traits, flags=flags, warnings=warnings)


def _describe(thing: LeftOut, scale: Scale | None, plant: Plant | None) -> str:
    if scale is None or plant is None:
        return thing.reason
    x, y, z = PlantFrame(scale, plant.foot).cm(np.array(thing.centre_su))
    return f"{thing.reason} at {x:.0f}, {y:.0f}, {z:.0f} cm, {thing.diameter_su * scale.cm_per_su:.1f} cm wide"


def summarise_plant(
    bolls: Sequence[BollTraits],
    silhouette: PlantSize | None,
    scale: Scale | None,
    pixel_su: float = 0.0,
    halves: tuple[int, int] | None = None,
    perhaps: PlantSize | None = None,
    conditions: Conditions = USUAL_CONDITIONS,
    left_out: Sequence[LeftOut] = (),
) -> PlantTraits:
    """The plant's row. Its volume is that of the bolls whose volume is known; NaN without any.

    Bolls that do not hang on the plant only affect the count's error, because they may belong to it after all.

    Args:
        pixel_su, halves, conditions, left_out: as for `measure_parts` and `measure_whole`.
        perhaps: another size that the plant may have; its difference is an error.

    The errors of its traits are in error_model.py.
    """
    flags = []
    found, bolls = bolls, [boll for boll in bolls if is_counted(boll.flags)]
    if halves:
        halves = (max(halves[0] + len(bolls) - len(found), 0), max(halves[1] + len(bolls) - len(found), 0))
    volumes = np.array([boll.volume_cm3 for boll in bolls])
    known = volumes[np.isfinite(volumes)]
    if scale and len(known) < len(volumes):
        flags.append("bolls_without_volume")
    if bolls and np.mean([bool(boll.flags) for boll in bolls]) >= DOUBTFUL_SHARE:
        flags.append("doubtful_bolls")
    measured = bool(scale) and len(known) > 0
    size = silhouette or PlantSize()
    other = perhaps or size
    pixel_cm = pixel_su * scale.cm_per_su if scale else np.nan
    places = np.array([boll.centre_cm for boll in bolls]).reshape(-1, 3)
    nearest = nearest_neighbours(places, np.array([boll.diameter_cm for boll in bolls]))
    touching = find_touching(nearest)
    unround = np.array([UNROUND_FLAG in boll.flags for boll in bolls], bool)
    nearest[unround] = np.minimum(nearest[unround], AS_IF_NEAR)
    if bolls and touching.mean() > CROWDED_SHARE:
        flags.append("touching_bolls")
    areas = np.array([boll.projected_area_cm2 for boll in bolls])
    hulls = np.array([boll.volume_published_cm3 for boll in bolls])
    hulls = hulls[np.isfinite(hulls)]
    heights = np.array([boll.centre_cm[2] for boll in bolls])
    heights = heights[np.isfinite(heights)]
    thirds = None
    if size.height_cm > 0 and len(heights) == len(bolls):
        counts = np.bincount(np.clip(3 * heights / size.height_cm, 0, 2).astype(np.int64), minlength=3)
        thirds = (int(counts[0]), int(counts[1]), int(counts[2]))
    volume_cm3 = float(known.sum()) if measured else np.nan
    crowded = dict(zip((boll.boll_id for boll in bolls), touching, strict=True))
    touches = [bool(crowded.get(boll.boll_id)) for boll in found]
    cm = scale.cm_per_su if scale else np.nan
    possible = [Possible(thing.probability, np.pi / 6 * (thing.diameter_su * cm) ** 3) for thing in left_out]
    count = distribute_count(found, touches, halves, conditions, possible)
    missing = miscounted_volume(found, touches, conditions, possible) if measured else Moments(np.nan, np.nan)
    of_bolls = plant_volume_error_cm3(bolls, nearest, scale, pixel_cm, conditions) if measured else np.nan
    of_volume = float(np.hypot(of_bolls, np.sqrt(missing.variance)))
    of_height = size_error_cm(size.height_cm, scale, pixel_cm, [other.height_cm])
    canopies_cm = [other.canopy_cm, size.turned_canopy_cm]
    of_canopy = size_error_cm(size.canopy_cm, scale, pixel_cm, canopies_cm, conditions.blur_px)
    return PlantTraits(
        boll_count=len(bolls),
        boll_volume_cm3=volume_cm3,
        boll_volume_mean_cm3=float(known.mean()) if len(known) else np.nan,
        plant_height_cm=size.height_cm,
        plant_height_obb_cm=size.height_obb_cm,
        canopy_size_cm=size.canopy_cm,
        canopy_length_cm=size.length_cm,
        canopy_width_cm=size.width_cm,
        flags=tuple(flags),
        plant_hull_volume_cm3=size.hull_volume_cm3,
        boll_height_mean_cm=float(heights.mean()) if len(heights) else np.nan,
        boll_height_sd_cm=float(heights.std(ddof=1)) if len(heights) > 1 else np.nan,
        boll_height_min_cm=float(heights.min()) if len(heights) else np.nan,
        boll_height_max_cm=float(heights.max()) if len(heights) else np.nan,
        bolls_by_third=thirds,
        lint_area_cm2=float(areas[np.isfinite(volumes)].sum()) if measured else np.nan,
        boll_count_error=count.error_about(len(bolls)) if count else np.nan,
        boll_volume_error_cm3=float(np.hypot(of_volume, missing.mean)),
        plant_height_error_cm=of_height,
        canopy_size_error_cm=of_canopy,
        boll_volume_published_cm3=float(hulls.sum()) if scale and len(hulls) else np.nan,
        plant_height_published_cm=size.published.height_cm,
        canopy_size_published_cm=size.published.canopy_cm,
        boll_count_halves=halves,
        boll_count_interval=count.interval(len(bolls)) if count else None,
        boll_volume_interval_cm3=interval(volume_cm3, of_volume, missing.mean),
        plant_height_interval_cm=interval(size.height_cm, of_height),
        canopy_size_interval_cm=interval(size.canopy_cm, of_canopy),
    )
