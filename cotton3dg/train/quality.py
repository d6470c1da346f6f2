# SPDX-License-Identifier: Apache-2.0
"""How good a trained model is, by photos that it was not trained on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.machine import on_all_cores
from ..core.runs import StageOutcome
from ..gaussians.metrics import PLANT_REGION, ViewQuality, mean_known, view_quality
from ..geometry.camera_orbit import fit_orbit
from ..schemas.train import Effects, HeldOut, RejectedStep, TrainedSteps, TrainMetrics
from .photos import Capture
from .trainer import Fit

LOW_PSNR_DB: Final = 22.0
"""PSNR below which the render is visibly blurred, and traits measured on it are doubtful."""
USED_BUDGET: Final = 0.9
"""Share of its budget of Gaussians below which a model is blurred where it could be sharp."""
COMPARISONS: Final = 4
"""Held-out photos that are shown beside their renders."""


@dataclass(frozen=True)
class Judged:
    """The results of judging a model."""

    metrics: TrainMetrics
    comparisons: dict[str, NDArray[np.uint8]]
    """Name of a held-out photo -> (H, 2 W, 3) the photo beside its render."""


def evaluate_held_out(result: Fit, capture: Capture) -> Judged:
    """Compare the model with the held-out photos."""
    views, held_out = capture.views, capture.held_out
    orbit = fit_orbit([view.camera for view in views])
    qualities = on_all_cores(
        lambda number: view_quality(result.gaussians, held_out[number], orbit, capture.held_out_gains[number]),
        range(len(held_out)),
    )
    pixel_su = orbit.distance / float(np.median([view.camera.fx for view in views]))
    shown = np.unique(np.linspace(0, len(qualities) - 1, min(COMPARISONS, len(qualities))).round().astype(int))
    comparisons = {qualities[i].name: np.concatenate([held_out[i].image, qualities[i].rendered], axis=1) for i in shown}
    return Judged(metrics_of(result, qualities, pixel_su), comparisons)


def metrics_of(result: Fit, qualities: list[ViewQuality], pixel_su: float) -> TrainMetrics:
    """The content of metrics.json.

    Args:
        pixel_su: size of a training image's pixel at the point at which the cameras look.
    """
    last = result.history[-1]
    return TrainMetrics(
        psnr_db=mean_known(quality.psnr_db for quality in qualities),
        ssim=mean_known(quality.ssim for quality in qualities),
        plant_psnr_db=mean_known(quality.plant_psnr_db for quality in qualities),
        plant_ssim=mean_known(quality.plant_ssim for quality in qualities),
        plant_region=f"rendered surfaces within {PLANT_REGION} of the cameras' distance from their centre",
        n_gaussians=len(result.gaussians),
        steps=last["step"],
        seconds=last["seconds"],
        cpu_seconds=last["cpu_seconds"],
        n_pruned=result.n_pruned,
        n_split=result.n_split,
        culled=result.culled,
        skipped_updates=result.n_skipped,
        budget=result.budget,
        rejected_steps=tuple(RejectedStep(step, name) for step, name in result.rejected),
        held_out=tuple(
            HeldOut(each.name, each.psnr_db, each.ssim, each.plant_psnr_db, each.plant_ssim, each.plant_share)
            for each in qualities
        ),
        history=tuple(TrainedSteps(**reached) for reached in result.history),
        pixel_su=pixel_su,
    )


def outcome_of(metrics: TrainMetrics, effects: Effects) -> StageOutcome:
    """Summary, flags and warnings of the stage."""
    summary = {
        "psnr_db": round(metrics.psnr_db, 2),
        "plant_psnr_db": round(metrics.plant_psnr_db, 2),
        "n_gaussians": metrics.n_gaussians,
        "steps": metrics.steps,
        "seconds": round(metrics.seconds, 2),
        "cpu_seconds": round(metrics.cpu_seconds, 2),
        "effects": ", ".join(effects.on) or "none",
    }
    flags, warnings = [], []
    unusable = {reason: n for reason, n in metrics.culled.items() if n}
    if unusable:
        flags.append("gaussians_culled")
        counts = ", ".join(f"{n} {reason.replace('_', ' ')}" for reason, n in unusable.items())
        warnings.append(f"Gaussians that cannot be drawn were left out ({counts}, summed over steps)")
    if metrics.skipped_updates:
        warnings.append(
            f"{metrics.skipped_updates} updates of single Gaussians were left out, as their gradient was not finite"
        )
    reached = metrics.history[-1].n_gaussians
    if metrics.budget and reached < USED_BUDGET * metrics.budget:
        warnings.append(
            f"the model grew to {reached} of the {metrics.budget} Gaussians that it may have; raise train.steps"
        )
    if metrics.psnr_db < LOW_PSNR_DB:
        flags.append("low_psnr")
        warnings.append(f"renders differ from the photos (PSNR {metrics.psnr_db:.1f} dB); try --preset paper")
    if metrics.rejected_steps:
        flags.append("training_steps_rejected")
        warnings.append(
            f"{len(metrics.rejected_steps)} training steps had a loss that was not finite and were undone; metrics.json"
            " names their images, records/train.rejected.npz holds the first"
        )
    return StageOutcome(summary, tuple(flags), tuple(warnings))
