# SPDX-License-Identifier: Apache-2.0
"""Are effects of the camera found where they are, and nowhere else? Twelve simulated clips whose effects are known.

    python tests/accuracy/effect_decisions.py FOLDER [--only NAME ...] [--weak]

Films each clip, finds its cameras and asks for the evidence, without training anything: about 25 s of processor time a
clip. A clip that is there already is not made again. Prints the evidence of each clip and the confusion table of each
effect; exits with 1 where a clip without effects raises an alarm or fewer than nine decisions of ten are right.
With --weak: twenty other clips, each with one effect about as strong as the program's threshold; prints what was found
of each, and alarms about the other effects.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from cotton3dg import pipeline
from cotton3dg.commands.simulate import simulate
from cotton3dg.options import SimulateOptions, TrainOptions
from cotton3dg.schemas.train import Effects
from cotton3dg.train.stage import load_capture
from cotton3dg.workspace import Workspace

CLIP = SimulateOptions(bolls=8, frames=60, width=480, height=270, mask_interval=60, noise=2.0)
"""Ten times faster than people walk: a share of a frame stands for ten times that in a video of 20 s."""

CLIPS: dict[str, dict[str, Any]] = {
    "none-1": {"seed": 301},
    "none-2": {"seed": 302, "clustered": 0.5},
    "none-3": {"seed": 303, "noise": 6.0},
    "none-4": {"seed": 304, "noise": 0.0},
    "exposure": {"seed": 305, "exposure": 0.3},
    "distortion": {"seed": 306, "distortion": -0.05},
    "blur": {"seed": 307, "blur": 0.3},
    "rolling shutter": {"seed": 308, "rolling_shutter": 0.4},
    "exposure, blur": {"seed": 309, "exposure": 0.3, "blur": 0.3},
    "distortion, rolling shutter": {"seed": 310, "distortion": 0.05, "rolling_shutter": 0.4},
    "exposure, distortion": {"seed": 311, "exposure": 0.3, "distortion": 0.05},
    "blur, rolling shutter": {"seed": 312, "blur": 0.3, "rolling_shutter": 0.4},
}
"""Name -> options of `simulate` besides CLIP."""
WEAK_STRENGTHS = {
    "exposure": (0.02, 0.03, 0.045, 0.06, 0.1),
    "distortion": (-0.004, -0.007, -0.01, -0.015, -0.025),
    "blur": (0.03, 0.05, 0.065, 0.09, 0.13),
    "rolling_shutter": (0.03, 0.05, 0.07, 0.1, 0.15),
}
"""Option of `simulate` -> values from about half of the program's threshold to twice and more."""
WEAK = {
    f"{option} {value}": {"seed": seed, option: value}
    for seed, (option, value) in enumerate(
        ((option, value) for option, values in WEAK_STRENGTHS.items() for value in values), start=321
    )
}

EFFECTS = {
    "exposure": ("exposure", "spread_pct", "error_pct"),
    "distortion": ("distortion", "rise_pct", ""),
    "blur": ("motion_blur", "median_px", "error_px"),
    "rolling_shutter": ("rolling_shutter", "shift_px", ""),
}
"""Option of `simulate` -> field of the effects, what tells and its standard error."""


def evidence(folder: Path, name: str, effects: dict[str, Any]) -> Effects:
    """What was found in a clip, filmed if need be."""
    clip = folder / name.replace(", ", "-").replace(" ", "-")
    if not (clip / "truth.json").is_file():
        simulate(clip, replace(CLIP, **effects))
    workspace = Workspace(clip)
    options = pipeline.stage_options(workspace, overrides={"frames": {"count": CLIP.frames}})
    pipeline.run(workspace, options, ("frames", "sfm"))
    return load_capture(workspace, TrainOptions()).effects


def rows(name: str, filmed: dict[str, Any], effects: Effects) -> list[dict[str, Any]]:
    """A row an effect: whether it is there, whether it was found, and by which figure."""
    told = []
    for option, (key, figure, error) in EFFECTS.items():
        found = vars(getattr(effects, key))
        told.append(
            {
                "clip": name,
                "effect": option,
                "there": bool(filmed.get(option)),
                "found": bool(found["on"] or found.get("found")),
                "evidence": f"{found[figure]:.2f}" + (f" ± {found[error]:.2f}" if error else "") + f" {figure[-3:]}",
            }
        )
    return told


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", choices=CLIPS)
    parser.add_argument("--weak", action="store_true", help="clips whose effects are near the thresholds")
    wanted = parser.parse_args()
    clips = WEAK if wanted.weak else {name: CLIPS[name] for name in wanted.only or CLIPS}
    decisions = []
    for name, effects in clips.items():
        decisions += rows(name, effects, evidence(wanted.folder, name, effects))
        told = (f"{row['effect']}: {row['evidence']}, {row['found']}" for row in decisions[-4:])
        print(name, *told, sep="; ", flush=True)
    table = pd.DataFrame(decisions)
    if wanted.weak:
        print(table[table["there"]].drop(columns=["there"]).to_string(index=False))
        others = table[~table["there"]]
        print(f"\n{others['found'].sum()} alarms in {len(others)} decisions about other effects")
        return
    shown = table.assign(decision=table["evidence"] + table["found"].map({True: ", found", False: ""}))
    print(shown.pivot(index="clip", columns="effect", values="decision").loc[list(clips)].to_string())
    table["right"] = table["there"] == table["found"]
    counts = table.groupby(["effect", "there", "found"]).size().unstack(fill_value=0)
    print(f"\n{counts}\n\n{table['right'].mean():.0%} of {len(table)} decisions are right")
    clean = ~table.groupby("clip")["there"].transform("any")
    sys.exit(bool((clean & table["found"]).any() or table["right"].mean() < 0.9))


if __name__ == "__main__":
    main()
