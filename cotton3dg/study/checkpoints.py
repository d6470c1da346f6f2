# SPDX-License-Identifier: Apache-2.0
"""The models that one training passes through, each saved as if the training had ended there."""

from __future__ import annotations

import time
from collections.abc import Mapping

from ..core.runs import Progress, StageOutcome, silent
from ..core.scene import Gaussians
from ..options import TrainOptions
from ..train.stage import load_capture, load_start, load_windows, save_model
from ..train.trainer import Fit, fit
from ..workspace import Workspace


def save_intermediate_models(
    workspace: Workspace, options: TrainOptions, targets: Mapping[int, Workspace], progress: Progress = silent
) -> dict[int, StageOutcome]:
    """Train once and save the model after given numbers of steps as the result of the stage train in other folders.

    The schedules of a training depend on its last step: a training that ends at an earlier step does better there than
    this one.

    Args:
        targets: number of steps -> workspace whose train folder gets the model. The clock stops while models are saved.
    """
    began, cpu_began = time.perf_counter(), time.process_time()
    capture = load_capture(workspace, options)
    outcomes: dict[int, StageOutcome] = {}

    def watch(step: int, gaussians: Gaussians) -> None:
        nonlocal began, cpu_began
        if step not in targets or step == options.steps:
            return
        now, cpu_now = time.perf_counter(), time.process_time()
        reached = {
            "step": step,
            "seconds": round(now - began, 3),
            "cpu_seconds": round(cpu_now - cpu_began, 3),
            "n_gaussians": len(gaussians),
        }
        outcomes[step] = save_model(targets[step], Fit(gaussians, [reached]), capture)
        began, cpu_began = began + time.perf_counter() - now, cpu_began + time.process_time() - cpu_now

    start = load_start(workspace, options, capture.training)
    windows = load_windows(workspace, options, capture.training)
    result = fit(start, capture.training, options, progress, watch, windows=windows)
    if options.steps in targets:
        result.history[-1] |= {
            "seconds": round(time.perf_counter() - began, 3),
            "cpu_seconds": round(time.process_time() - cpu_began, 3),
        }
        outcomes[options.steps] = save_model(targets[options.steps], result, capture)
    return outcomes
