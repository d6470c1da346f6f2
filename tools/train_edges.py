"""Train the network of lint's edges anew, from finished runs of simulated plants.

    python tools/train_edges.py RUN ... --out edges.onnx

Each RUN is a plant's folder with masks of `bolls`, a trained model and the simulator's `instances`, as
`tests/accuracy/study_set.py` leaves them. Writes the network, and its checksum beside it.
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from cotton3dg.evaluation.masks import read_true_masks
from cotton3dg.gaussians.plant_windows import SEEN_MARGIN, find_plant_windows
from cotton3dg.geometry.camera_orbit import azimuths, evenly_spaced, fit_orbit
from cotton3dg.io.annotations import undistort_ids
from cotton3dg.masks.bolls import open_bolls
from cotton3dg.masks.edge_training import EdgePicture, to_onnx, train_edges
from cotton3dg.masks.lint_edges import SHOWN
from cotton3dg.masks.lint_in_space import gather_lint
from cotton3dg.masks.stage import load_plant
from cotton3dg.options import MasksOptions
from cotton3dg.workspace import Workspace

PICTURES = 12
"""Of a plant, evenly spaced."""
MARGIN_PX = 32


def pictures_of(run: Workspace) -> Iterator[EdgePicture]:
    """What the network is told of a run's images, with the truth; the plant's part of each."""
    plant, truths = load_plant(run, MasksOptions()), read_true_masks(run, run.root / "instances")
    if plant.model is None or plant.allowed is None:
        raise SystemExit(f"{run.root} has no trained model; run it first")
    chosen = evenly_spaced(azimuths(plant.cameras, fit_orbit(plant.cameras)), MasksOptions.views)
    windows = find_plant_windows(plant.points, plant.cameras, SEEN_MARGIN)
    network, views = open_bolls(), [plant.cameras[k] for k in chosen]
    maps = [network.maps(plant.photo(plant.cameras[k].name), window=windows[k]) for k in chosen]
    lint = gather_lint(maps, views, plant.model, plant.allowed)
    judged = [k for k, camera in enumerate(views) if Path(camera.name).stem in truths]
    for k in judged[:: max(len(judged) // PICTURES, 1)]:
        camera, stem = views[k], Path(views[k].name).stem
        share = lint.seen(camera)[0]
        left, top, width, height = cv2.boundingRect((share > SHOWN).astype(np.uint8))
        part = tuple(slice(max(low - MARGIN_PX, 0), low + n + MARGIN_PX) for low, n in ((top, height), (left, width)))
        likely = cv2.resize(maps[k].lint, share.shape[::-1], interpolation=cv2.INTER_LINEAR)
        true = undistort_ids(stem, truths[stem], camera, plant.filmed)
        yield EdgePicture(plant.photo(camera.name)[part], share[part], likely[part], np.ascontiguousarray(true[part]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("edges.onnx"))
    parser.add_argument("--steps", type=int, default=2500)
    parser.add_argument("--seed", type=int, default=0)
    wanted = parser.parse_args()
    pictures: list[EdgePicture] = []
    for folder in wanted.runs:
        pictures += pictures_of(Workspace(folder))
        print(f"{folder.name}: {len(pictures)} pictures", flush=True)
    weights = to_onnx(train_edges(pictures, wanted.steps, wanted.seed))
    wanted.out.write_bytes(weights)
    checksum = f"{hashlib.sha256(weights).hexdigest()}  {wanted.out.name}\n"
    wanted.out.with_name(f"{wanted.out.name}.sha256").write_text(checksum, encoding="ascii")


if __name__ == "__main__":
    main()
