"""`run --repeat`: measures one film several times; how much a row depends on frames and on chance in training."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from .. import pipeline
from ..errors import BadUsage
from ..evaluation.repeatability import Repeats, repeat
from ..evaluation.repeatability_page import write_repeats
from ..schemas.frames import FramesInfo
from ..workspace import Workspace


def repeat_runs(
    workspace: Workspace,
    options: dict[str, Any],
    times: int,
    tell: Callable[[str], None],
    watcher: pipeline.Watcher | None = None,
) -> Repeats:
    """Run a finished plant's capture `times` more times and compare the runs with it; tables and picture in `repeats/`.

    Each run has one frame fewer than the run before and another seed of training. Frames stand at even steps of the
    way, so that one frame fewer moves all but the first and the last. The runs show nothing about what they share: the
    film itself, its light, and the size of the table.

    Raises:
        BadUsage: the model was trained elsewhere, on frames that the user gave.
        Cotton3dgError: a run failed, or cannot be compared.
    """
    if options["train"].model:
        raise BadUsage("--repeat trains anew; leave out train.model")
    n_frames = len(FramesInfo.load(workspace.frames_json).images)
    runs = [workspace]
    for number in range(1, times + 1):
        tell(f"run {number} of {times} for --repeat")
        again = workspace.repeat_run(number)
        workspace.share_inputs(again)
        changed = {
            "frames": replace(options["frames"], count=n_frames - number),
            "train": replace(options["train"], seed=options["train"].seed + number),
        }
        pipeline.run(again, options | changed, watcher=watcher)
        runs.append(again)
    repeats = repeat([run.root for run in runs], turn_deg=0.0)
    write_repeats(workspace.repeats, repeats)
    return repeats
