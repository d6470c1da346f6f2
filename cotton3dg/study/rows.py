# SPDX-License-Identifier: Apache-2.0
"""The row of a finished setting: its traits, time and memory, and the quality and speed of its renders."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..core.machine import usable_cores
from ..core.runs import State
from ..core.scene import Gaussians
from ..errors import BadInput
from ..gaussians.metrics import ViewQuality, mean_known, view_quality
from ..gaussians.rasterizer import render
from ..gaussians.views import View, hold_out
from ..io.colmap import read_points
from ..io.ply import read_gaussians
from ..io.saving import file_sha256
from ..io.tables import parse_number, read_rows
from ..options import TrainOptions
from ..schemas.document import Document
from ..schemas.train import Effects, TrainMetrics
from ..stage import STAGES
from ..train.stage import load_views
from ..workspace import Workspace
from .lpips import measure_lpips
from .plant_region import PlantRegions, resized
from .tables import COLUMNS, ERRORS, PUBLISHED

RECORD: Final = "study"
FULL_SIDE: Final = 960
"""Size of the images at which all models are compared, px; smaller images keep their own size."""
TIMED_CAMERAS: Final = 5
TIMED_TIMES: Final = 3
"""The rendering time is the median over this many cameras, each the best of this many times."""


@dataclass(frozen=True)
class RenderingInfo(Document):
    """records/study.json: the speed and quality of a model's renders, kept because the measurement takes a while."""

    REMEDY = "run `cotton3dg study`"

    model: str
    """`Gaussians.sha256()` of the model."""
    render_s: float
    """On the clock, with all cores."""
    plant_psnr_db: float
    """PSNR over the plant's pixels of the held-out images, the same for all models, at the training's size; ..."""
    plant_ssim: float
    full_psnr_db: float
    """... and at `FULL_SIDE`."""
    lpips: float = math.nan
    """LPIPS of the held-out images at the training's size; NaN without a network."""
    lpips_weights: str = ""
    """The network's file."""


def empty_row(sweep: str, setting: str, state: State, reason: str = "") -> dict[str, Any]:
    blank = dict.fromkeys((column.name for column in COLUMNS), None)
    return blank | {"sweep": sweep, "setting": setting, "state": state, "reason": reason}


def finished_row(
    workspace: Workspace,
    sweep: str,
    setting: str,
    options: TrainOptions,
    regions: PlantRegions,
    lpips: Path | None = None,
) -> dict[str, Any]:
    """The study's row for a finished folder; seconds are those of all stages, whichever setting ran them."""
    records = [record for record in map(workspace.read_record, STAGES) if record]
    (traits,) = read_rows(workspace.traits_csv)
    metrics = TrainMetrics.load(workspace.metrics_json)
    cpu_s = sum(record.cpu_seconds for record in records)
    row = empty_row(sweep, setting, State.DONE)
    row |= {key: getattr(metrics, key) for key in ("psnr_db", "ssim", "n_gaussians")}
    row |= {trait: parse_number(traits[trait]) for trait in (*ERRORS, *PUBLISHED)}
    row |= {
        "n_frames": int(traits["n_frames"]),
        "seconds": sum(record.seconds for record in records),
        "cpu_seconds": cpu_s,
        "idle_seconds": cpu_s / len(usable_cores()),
        "peak_memory_mib": max(record.peak_memory_mib for record in records),
    }
    rendering = _rendering(workspace, options, regions, lpips)
    row |= {key: getattr(rendering, key) for key in ("plant_psnr_db", "plant_ssim", "full_psnr_db", "lpips")}
    return row | {"fps": 1 / rendering.render_s}


def _rendering(workspace: Workspace, options: TrainOptions, regions: PlantRegions, lpips: Path | None) -> RenderingInfo:
    """Time of a render at the training's size, PSNR of the plant there and at full size, LPIPS; once per model."""
    gaussians = read_gaussians(workspace.gaussians_ply)
    weights = file_sha256(lpips) if lpips else ""
    with suppress(BadInput):
        known = RenderingInfo.load(workspace.record_file(RECORD))
        if (known.model, known.lpips_weights) == (gaussians.sha256(), weights):
            return known
    views = load_views(workspace, FULL_SIDE)
    exposure = Effects.load(workspace.effects_json).exposure
    gains = (exposure.gains or {}) if exposure.on else {}
    points, _, _, _ = read_points(workspace.undistorted / "sparse")
    plants = regions.of_held_out(views, options.holdout, points)
    _, held_out = hold_out(views, options.holdout)
    small = [view.limited(options.max_side) for view in held_out]

    def qualities_of(some: list[View]) -> list[ViewQuality]:
        return [
            view_quality(gaussians, view, resized(plant, view), np.array(gains.get(view.camera.name, (1.0, 1.0, 1.0))))
            for view, plant in zip(some, plants, strict=True)
        ]

    full = qualities_of(held_out)
    trained = full if options.max_side >= FULL_SIDE else qualities_of(small)
    sample = [views[round(i)] for i in np.linspace(0, len(views) - 1, TIMED_CAMERAS)]
    found = RenderingInfo(
        gaussians.sha256(),
        render_s=float(np.median([_render_s(gaussians, view.limited(options.max_side)) for view in sample])),
        plant_psnr_db=mean_known([quality.plant_psnr_db for quality in trained]),
        plant_ssim=mean_known([quality.plant_ssim for quality in trained]),
        full_psnr_db=mean_known([quality.plant_psnr_db for quality in full]),
        lpips=measure_lpips(lpips, gaussians, small, gains),
        lpips_weights=weights,
    )
    workspace.keep(found, RECORD)
    return found


def _render_s(gaussians: Gaussians, view: View) -> float:
    """Least clock time of a few renders, s: other programs disturb some of them."""
    times = []
    for _ in range(TIMED_TIMES):
        began = time.perf_counter()
        render(gaussians, view.camera)
        times.append(time.perf_counter() - began)
    return min(times)
