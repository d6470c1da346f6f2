"""The row of a finished setting: its traits, time and memory, and how well and how fast its model renders."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.machine import usable_cores
from ..core.scene import Gaussians
from ..core.state import State
from ..documents.document import Document
from ..documents.train import Effects, TrainMetrics
from ..errors import BadInput
from ..files.ply import read_gaussians
from ..files.saving import file_sha256
from ..files.tables import parse_number, read_rows
from ..geometry.camera_orbit import fit_orbit
from ..options import TrainOptions
from ..splat.metrics import view_quality
from ..splat.rasterizer import render
from ..splat.views import View, hold_out
from ..stages.stage import STAGES
from ..stages.train import load_views
from ..workspace import Workspace
from .lpips import measure_lpips
from .tables import COLUMNS, ERRORS, PUBLISHED

RECORD = "study"
FULL_SIDE = 960
"""All models are compared at this size of the images, px, or at their own if smaller."""
TIMED_CAMERAS, TIMED_TIMES = 5, 3
"""The time of rendering is the median over so many cameras, each the best of so many times."""


@dataclass(frozen=True)
class RenderingInfo(Document):
    """records/study.json: how fast and how well a model renders, as measuring it takes a while."""

    REMEDY = "run `cotton3dg study`"

    model: str
    """`Gaussians.sha256()` of it."""
    render_s: float
    """On the clock, with all cores."""
    full_psnr_db: float
    lpips: float = math.nan
    """Of the held-out images at the training's size; NaN without a network."""
    lpips_weights: str = ""
    """Which network."""


def empty_row(sweep: str, setting: str, state: State, reason: str = "") -> dict[str, Any]:
    blank = dict.fromkeys((column.name for column in COLUMNS), None)
    return blank | {"sweep": sweep, "setting": setting, "state": state, "reason": reason}


def finished_row(
    workspace: Workspace, sweep: str, setting: str, options: TrainOptions, lpips: Path | None = None
) -> dict[str, Any]:
    """What the study says of a finished folder; seconds are those of all stages, whichever setting ran them."""
    records = [record for record in map(workspace.read_record, STAGES) if record]
    (traits,) = read_rows(workspace.traits_csv)
    metrics = TrainMetrics.load(workspace.metrics_json)
    cpu_s = sum(record.cpu_seconds for record in records)
    row = empty_row(sweep, setting, State.DONE)
    row |= {key: getattr(metrics, key) for key in ("psnr_db", "ssim", "plant_psnr_db", "plant_ssim")}
    row |= {trait: parse_number(traits[trait]) for trait in (*ERRORS, *PUBLISHED)}
    row |= {
        "n_gaussians": metrics.n_gaussians,
        "n_frames": int(traits["n_frames"]),
        "seconds": sum(record.seconds for record in records),
        "cpu_seconds": cpu_s,
        "idle_seconds": cpu_s / len(usable_cores()),
        "peak_memory_mib": max(record.peak_memory_mib for record in records),
    }
    rendering = _rendering(workspace, options, lpips)
    return row | {
        "fps": 1 / rendering.render_s,
        "full_psnr_db": rendering.full_psnr_db,
        "lpips": rendering.lpips,
    }


def _rendering(workspace: Workspace, options: TrainOptions, lpips: Path | None) -> RenderingInfo:
    """Time of a render at the training's size, PSNR of the plant at full size, and LPIPS; measured once a model."""
    gaussians = read_gaussians(workspace.gaussians_ply)
    weights = file_sha256(lpips) if lpips else ""
    with suppress(BadInput):
        known = RenderingInfo.load(workspace.record_file(RECORD))
        if (known.model, known.lpips_weights) == (gaussians.sha256(), weights):
            return known
    views = load_views(workspace, FULL_SIDE)
    orbit = fit_orbit([view.camera for view in views])
    exposure = Effects.load(workspace.effects_json).exposure
    gains = (exposure.gains or {}) if exposure.on else {}
    _, held_out = hold_out(views, options.holdout)
    qualities = [
        view_quality(gaussians, view, orbit, np.array(gains.get(view.camera.name, (1.0, 1.0, 1.0)))).plant_psnr_db
        for view in held_out
    ]
    finite = [quality for quality in qualities if math.isfinite(quality)]
    sample = [views[round(i)] for i in np.linspace(0, len(views) - 1, TIMED_CAMERAS)]
    found = RenderingInfo(
        gaussians.sha256(),
        render_s=float(np.median([_render_s(gaussians, view.limited(options.max_side)) for view in sample])),
        full_psnr_db=float(np.mean(finite)) if finite else math.nan,
        lpips=measure_lpips(lpips, gaussians, [view.limited(options.max_side) for view in held_out], gains),
        lpips_weights=weights,
    )
    workspace.keep(found, RECORD)
    return found


def _render_s(gaussians: Gaussians, view: View) -> float:
    """Least time of a few renders on the clock, s: other programs disturb some of them."""
    times = []
    for _ in range(TIMED_TIMES):
        began = time.perf_counter()
        render(gaussians, view.camera)
        times.append(time.perf_counter() - began)
    return min(times)
