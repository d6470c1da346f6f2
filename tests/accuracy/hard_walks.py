# SPDX-License-Identifier: Apache-2.0
"""Films as people make them, judged by `cotton3dg check`: eight kinds of fault, five plants each.

    python tests/accuracy/hard_walks.py FOLDER [--kinds half_turn,cut] [--seeds 1,2] [--run]

Each walk is simulated small into FOLDER (once), checked, and with --run measured to the end. A verdict is right when it
is the one that the fault deserves, named below, or, with --run, when it is green and the count is within 1 and height
and canopy within 2 % of the truth, or not green and the row is flagged, refused or off; and it is told how many of the
row's 95 % intervals hold the truth. Writes hard_walks.csv and prints a table.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from interval_coverage import TRAITS, holds, judged
from markdown_tables import markdown

from cotton3dg import pipeline
from cotton3dg.commands.check import check
from cotton3dg.commands.simulate import simulate
from cotton3dg.errors import Cotton3dgError
from cotton3dg.options import resolve
from cotton3dg.schemas.check import GREEN, RED, YELLOW
from cotton3dg.workspace import Workspace

FILM = {"frames": 96, "width": 640, "height": 360, "supersampling": 1, "mask_interval": 48}
OPTIONS = {"frames": {"count": 60}}


@dataclass(frozen=True)
class Kind:
    """One kind of fault."""

    film: dict[str, Any]
    deserved: tuple[str, ...]
    """Verdicts that are right."""
    said: str = ""
    """What a verdict that is not green has to speak of."""


KINDS = {
    "good": Kind({}, (GREEN,)),
    "half_turn": Kind({"turn_deg": 200.0}, (YELLOW,), "degrees"),
    "short_arc": Kind({"turn_deg": 70.0}, (RED,), "degrees"),
    "uneven": Kind({"uneven": 0.9}, (GREEN, YELLOW)),
    "cut": Kind({"cut": 0.3}, (RED,), "cut by the top"),
    "white_room": Kind({"white_room": True, "noise": 2.0}, (GREEN, YELLOW, RED)),
    "pale_table": Kind({"pale_table": True}, (GREEN, YELLOW)),
    "turntable": Kind({"turntable": True}, (RED,), "stands still, though the plant may turn"),
    "blurred": Kind({"blur": 0.9, "frames": 150}, (GREEN, YELLOW)),
}


def walk(folder: Path, name: str, seed: int, run: bool) -> dict[str, Any]:
    """One row of the table."""
    kind, root = KINDS[name], folder / f"{name}_{seed}"
    if not (root / "video.mp4").is_file():
        simulate(root, resolve("simulate", {**FILM, "seed": seed, **kind.film}))
    truth = json.loads((root / "truth.json").read_text())
    workspace = Workspace(root)
    options = pipeline.stage_options(workspace, "draft", OPTIONS)
    cpu_s = time.process_time()
    info = check(workspace, options, pipeline.Watcher())
    right = info.verdict in kind.deserved and (info.verdict == GREEN or kind.said in info.line)
    row = {
        "kind": name,
        "seed": seed,
        "verdict": info.verdict,
        "right": right,
        "line": info.line,
        "placed": f"{info.figures.get('placed', '-')}/{info.figures.get('looked_at', '-')}",
        "bolls": info.figures.get("bolls", "-"),
        "true_bolls": truth["boll_count"],
        "seconds": round(time.process_time() - cpu_s, 1),
    }
    if run:
        outcome, good = measure(workspace, options, truth)
        row |= outcome | {"right": (info.verdict == GREEN) == good}
    return row


def measure(workspace: Workspace, options: dict[str, Any], truth: dict[str, Any]) -> tuple[dict[str, str], bool]:
    """What the whole run gives, in words, how many of its intervals hold, and whether it is good without a flag."""
    try:
        pipeline.run(workspace, options)
    except Cotton3dgError as error:
        return {"outcome": f"refused: {error}", "held": ""}, False
    found = judged(workspace, workspace.root / "truth.json")
    off = {trait: 100 * (found[trait] / found[f"true_{trait}"] - 1) for trait in TRAITS if trait != "count"}
    told = [f"{found['count']:.0f} bolls"] + [f"{trait} {pct:+.1f} %" for trait, pct in off.items() if np.isfinite(pct)]
    stated = [trait for trait in TRAITS if np.isfinite(found[f"{trait}_low"])]
    held = {trait: bool(holds(pd.DataFrame([found]), trait).all()) for trait in stated}
    told += [f"{trait} not held" for trait, holds_it in held.items() if not holds_it]
    good = abs(found["count"] - truth["boll_count"]) <= 1 and abs(off["height"]) <= 2 and abs(off["canopy"]) <= 2
    outcome = {"outcome": ", ".join([*told, found["flags"]]), "held": f"{sum(held.values())} of {len(held)}"}
    return outcome, good and not found["flags"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--seeds", default="11,12,13,14,15")
    parser.add_argument("--run", action="store_true")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in arguments.kinds.split(","):
        for seed in map(int, arguments.seeds.split(",")):
            rows.append(walk(arguments.folder, name, seed, arguments.run))
            print(rows[-1], flush=True)
    table = pd.DataFrame(rows)
    table.to_csv(arguments.folder / "hard_walks.csv", index=False)
    text = markdown(table.drop(columns="line"))
    print(text)
    print(f"{sum(row['right'] for row in rows)} of {len(rows)} verdicts right")


if __name__ == "__main__":
    main()
