# SPDX-License-Identifier: Apache-2.0
"""The time that a run will take: seconds of each stage from the number of images, their size, steps and Gaussians.

Each stage has a model of its own, in its module. Every term is work (images, pixels, pairs, steps) times the time per
unit on 2 cores of a server: a Xeon (Sapphire Rapids, AVX-512) for the training, an AMD EPYC (Zen 4) for all else.
Another machine differs by two factors, which `calibrate` measures: one for the splatting core, one for everything else.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from ..core.machine import usable_cores
from ..errors import as_capture_failure
from ..io.images import image_size, list_images
from ..sfm.stage import VIDEO_FEATURE_SIDE
from ..stage import STAGES, Cost, Footage, Work, stage_of
from ..workspace import Workspace

USUAL_FRAMES: Final = 900
"""Frames of a video that does not say how long it is: half a minute."""
REPORT: Final = Cost(0.0, 8.0)
"""The page and the start of the program."""


@dataclass(frozen=True)
class Machine:
    """The speed of this machine relative to the one on which the constants were measured."""

    cores: float
    """Number of cores that really work at once."""
    splatting: float = 1.0
    imaging: float = 1.0


def examine_footage(workspace: Workspace) -> Footage:
    """The contents of the capture, without decoding it.

    Raises:
        MissingInput: there is no capture. CaptureFailed: it cannot be read.
    """
    from ..io import video

    source = workspace.capture()
    if source.is_dir():
        images = list_images(source)
        size = image_size(images[0].read_bytes()) if images else None
        return Footage(len(images), *(size or (VIDEO_FEATURE_SIDE, VIDEO_FEATURE_SIDE)), is_video=False)
    with as_capture_failure():
        facts = video.probe(source)
    frames = facts.duration_s * facts.fps
    return Footage(max(1, round(frames)) if math.isfinite(frames) else USUAL_FRAMES, facts.width, facts.height)


def estimate_costs(options: Mapping[str, Any], source: Footage, machine: Machine | None = None) -> dict[str, Cost]:
    """Stage -> its cost with these options of all stages; `report` is the page and the start of the program."""
    machine, work = machine or Machine(len(usable_cores())), Work(options, source)
    factors = {stage: machine.splatting if stage_of(stage).splats else machine.imaging for stage in STAGES}
    by_stage = {stage: stage_of(stage).cost(work).times(factors[stage]) for stage in STAGES}
    return by_stage | {"report": REPORT.times(machine.imaging)}


def sum_seconds(by_stage: Mapping[str, Cost], cores: float) -> float:
    """Seconds of all stages together, on the clock of an idle machine."""
    return sum(cost.seconds(cores) for cost in by_stage.values())
