# SPDX-License-Identifier: Apache-2.0
"""How far the scale that a plant's card gives is off, on simulated films with a card on the table.

    python tests/accuracy/card_scale.py FOLDER [--seeds 1,2,3]

Each film is made (once) and placed by structure from motion; no model is trained, for the card needs none. The truth is
the distance of the true cameras.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markdown_tables import markdown
from true_scene import TruePlant, true_scale

from cotton3dg import pipeline
from cotton3dg.commands.simulate import simulate
from cotton3dg.io.colmap import read_points
from cotton3dg.options import resolve
from cotton3dg.scale.estimate_scale import estimate_scale
from cotton3dg.scale.stage import load_plant
from cotton3dg.workspace import Workspace

FILM = {"frames": 60, "width": 1280, "height": 720, "supersampling": 1, "mask_interval": 60}


def card_scale(root: Path, film: dict[str, Any]) -> dict[str, Any]:
    """One row of the table; the film is made unless it is there."""
    if not (root / "video.mp4").is_file():
        simulate(root, resolve("simulate", {**FILM, "card": "NC26-017", **film}))
    plant = Workspace(root)
    options = pipeline.stage_options(plant, "draft", {})
    pipeline.run(plant, options, ("frames", "sfm"), report=False)
    chosen = resolve("scale", {"method": "card"})
    tracks = read_points(plant.undistorted / "sparse")[0]
    found = estimate_scale(load_plant(plant, chosen, plant.undistorted, tracks, np.zeros((0, 3), np.float32)), chosen)
    scale = found.info.scale
    return {
        "film": root.name,
        "error, %": round(100 * (scale.cm_per_su / true_scale(TruePlant(plant, root)).cm_per_su - 1), 3)
        if scale
        else found.info.reason,
        "stated, %": round(100 * scale.relative_error, 3) if scale else "",
        "photos with patches": len(found.patches),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", default="1,2,3")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for seed in map(int, arguments.seeds.split(",")):
        rows.append(card_scale(arguments.folder / f"seed_{seed}", {"seed": seed}))
        print(rows[-1], flush=True)
    print(markdown(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()
