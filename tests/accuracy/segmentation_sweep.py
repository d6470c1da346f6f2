# SPDX-License-Identifier: Apache-2.0
"""From masks to bolls: methods x number of views x quality of the masks, on plants whose bolls are known.

    python tests/accuracy/segmentation_sweep.py FOLDER PLANT ... [--methods lift] [--masks exact found] [--minutes 25]

A PLANT is a folder where `cotton3dg run` is through, with `truth.json`, `cameras.json` and `instances/` in it or in the
folder given after a colon (RUN:TRUTH). Masks of the plant's images are made exact, degraded from these (15 % missed,
30 % of the pairs that touch in the image merged, 5 % split, edges 1 px off; the same in every run), or taken as the
plant's run made them (found). The default method is tried with every number of views, then those of the papers with 36
and with four. Nothing in the plants' folders changes.

Each trial is kept in FOLDER/PLANT.csv as it ends, and not repeated while the plant's model is the same: the command
continues after an interruption, and after --minutes of the processor, when it starts no more trials. At the end all are
gathered in FOLDER/segmentation.csv, and their means in .md.

A boll counts as found when its centre is within 3 cm of a true one's; model and truth are laid over each other by the
points of structure from motion, so that neither table nor scale has a say. Seconds are the processor's, of segment and
cluster; memory is what they took at most beyond what the process held before.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import re
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from markdown_tables import markdown
from true_scene import TruePlant, cm_from_scene, true_bolls_cm, true_masks, true_plant

sys.path.insert(0, str(Path(__file__).parents[1]))

from scenes.orbit_scene import degraded_masks

from cotton3dg.cluster import stage as cluster
from cotton3dg.evaluation.match import MATCH_DISTANCE_CM, match_bolls
from cotton3dg.geometry.camera_orbit import azimuths, evenly_spaced, fit_orbit
from cotton3dg.io.colmap import read_cameras
from cotton3dg.io.images import read_ids, write_ids
from cotton3dg.io.saving import file_sha256, write_text_atomically
from cotton3dg.options import ClusterOptions, ProbabilityOptions, SegmentOptions
from cotton3dg.schemas.bolls import read_bolls
from cotton3dg.segment import stage as segment
from cotton3dg.workspace import Workspace

METHODS = {"lift": "consensus", "probability": "consensus", "affinity": "dbscan"}
"""Method of segment -> of cluster."""
MASKS = ("found", "exact", "degraded")
VIEWS = (4, 8, 12, 24, 36, 48)
PAPER_VIEWS = (36, 4)
"""For the methods of the papers, which take up to a hundred times as long."""
TRIAL = ["masks", "views", "method"]


@lru_cache(maxsize=len(MASKS))
def masks_of(plant: TruePlant, kind: str) -> dict[str, np.ndarray]:
    """Image name -> ids at the size of the undistorted image, of all views that have masks."""
    cameras = read_cameras(plant.run.undistorted / "sparse")
    if kind == "found":
        files = {camera.name: plant.run.mask_png(camera.name) for camera in cameras}
        return {name: read_ids(path) for name, path in files.items() if path.is_file()}
    if kind == "exact":
        return true_masks(plant, cameras)
    exact = masks_of(plant, "exact")
    pairs = tuple(combinations(range(1, max(int(ids.max()) for ids in exact.values()) + 1), 2))
    rng = np.random.default_rng(0)
    return {name: degraded_masks(pairs, ids, rng) for name, ids in sorted(exact.items())}


def spread(plant: Workspace, masks: dict[str, np.ndarray], n_views: int) -> dict[str, np.ndarray]:
    """The masks of at most n_views views, evenly around the plant."""
    cameras = [camera for camera in read_cameras(plant.undistorted / "sparse") if camera.name in masks]
    chosen = evenly_spaced(azimuths(cameras, fit_orbit(cameras)), n_views)
    return {cameras[k].name: masks[cameras[k].name] for k in chosen}


def with_masks(plant: Workspace, masks: dict[str, np.ndarray], folder: str) -> Workspace:
    """An empty folder made a plant's with other masks; its model is linked to."""
    scratch = Workspace(folder)
    for stage in ("sfm", "train"):
        scratch.folder(stage).symlink_to(plant.folder(stage).resolve())
    with scratch.writing("masks") as partial:
        for name, ids in masks.items():
            write_ids(partial / scratch.mask_png(name).name, ids)
    return scratch


def trial(scratch: Workspace, options: SegmentOptions) -> dict[str, float]:
    """Processor time of segment and cluster, and how much memory they took at most."""
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    before_mb = memory_mb("VmRSS")
    begin_s = time.process_time()
    segment.run(scratch, options)
    cluster.run(scratch, ClusterOptions(method=METHODS[options.method]))
    return {"cpu_s": time.process_time() - begin_s, "peak_mb": memory_mb("VmHWM") - before_mb}


def memory_mb(kind: str) -> float:
    """What Linux says of this process: VmRSS, the memory it holds, or VmHWM, the most it held."""
    found = re.search(rf"{kind}:\s*(\d+) kB", Path("/proc/self/status").read_text(encoding="ascii"))
    return int(found[1]) / 1024 if found else math.nan


def scores(plant: TruePlant, scratch: Workspace) -> dict[str, float]:
    """Count error, %, precision, recall and F1 of the bolls in a scratch folder."""
    affine = cm_from_scene(plant)
    bolls, _ = read_bolls(scratch.bolls_json, scratch.labels_npy)
    found = np.array([boll.centre for boll in bolls]).reshape(-1, 3) @ affine[:, :3].T + affine[:, 3]
    true = true_bolls_cm(plant)
    hits = len(match_bolls(found, true, MATCH_DISTANCE_CM))
    return {
        "true": len(true),
        "found": len(found),
        "count_pct": 100 * (len(found) / len(true) - 1),
        "precision": hits / max(len(found), 1),
        "recall": hits / len(true),
        "f1": 2 * hits / (len(found) + len(true)),
    }


class Results:
    """The trials of one plant, kept in a file; those of another model are forgotten."""

    def __init__(self, plant: TruePlant, folder: Path):
        self.plant, self.csv = plant, folder / f"{plant.run.plant_id}.csv"
        self.model = file_sha256(plant.run.gaussians_ply)[:12]
        table = pd.read_csv(self.csv).to_dict("records") if self.csv.is_file() else []
        self.rows = [row for row in table if row["model"] == self.model]

    def has(self, *trial: object) -> bool:
        return any(tuple(row[key] for key in TRIAL) == trial for row in self.rows)

    def add(self, **row: object) -> None:
        self.rows.append({"plant": self.plant.run.plant_id, "model": self.model, **row})
        write_text_atomically(self.csv, pd.DataFrame(self.rows).to_csv(index=False))
        print(*(f"{v:.2f}" if isinstance(v, float) else v for v in self.rows[-1].values()), flush=True)


def sweep(
    results: Results, kind: str, views: Sequence[int], methods: Sequence[str], steps: int, until_s: float
) -> None:
    """The trials of one plant with one kind of masks that are not there yet, while there is time."""
    masks = masks_of(results.plant, kind) if time.process_time() < until_s else {}
    for n_views in sorted({min(n, len(masks)) for n in views if masks}):
        missing = [method for method in methods if not results.has(kind, n_views, method)]
        if not missing or time.process_time() > until_s:
            continue
        with tempfile.TemporaryDirectory() as folder:
            scratch = with_masks(results.plant.run, spread(results.plant.run, masks, n_views), folder)
            for method in missing:
                cost = trial(scratch, SegmentOptions(method=method, probability=ProbabilityOptions(steps=steps)))
                found = scores(results.plant, scratch)
                results.add(masks=kind, views=n_views, method=method, **found, **cost)


def means(table: pd.DataFrame) -> pd.DataFrame:
    """Means over plants of each kind of trial; count errors without sign."""
    ordered = {"masks": pd.Categorical(table["masks"], MASKS), "method": pd.Categorical(table["method"], METHODS)}
    table = table.assign(**ordered, count_mape_pct=table["count_pct"].abs())
    trials = table.groupby(["masks", "method", "views"], observed=True)
    columns = ["count_mape_pct", "precision", "recall", "f1", "cpu_s", "peak_mb"]
    return pd.concat([trials.size().rename("plants"), trials[columns].mean()], axis=1).reset_index()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("plants", nargs="+", type=true_plant, metavar="PLANT")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--masks", nargs="+", choices=MASKS, default=list(MASKS))
    parser.add_argument("--views", nargs="+", type=int, default=list(VIEWS))
    parser.add_argument("--paper-views", nargs="+", type=int, default=list(PAPER_VIEWS))
    parser.add_argument("--minutes", type=float, default=math.inf, help="of the processor; default: until all is done")
    parser.add_argument("--steps", type=int, default=ProbabilityOptions.steps, help="of the method probability")
    wanted = parser.parse_args()
    wanted.folder.mkdir(parents=True, exist_ok=True)
    until_s = 60 * wanted.minutes
    plants = [Results(plant, wanted.folder) for plant in wanted.plants]
    papers = [method for method in wanted.methods if method != "lift"]
    # What matters most comes first, so that a sweep that ends early has it of all plants.
    for results in plants if "lift" in wanted.methods else []:
        for kind in wanted.masks:
            sweep(results, kind, wanted.views, ["lift"], wanted.steps, until_s)
    for n_views in wanted.paper_views if papers else []:
        for kind in wanted.masks:
            for results in plants:
                sweep(results, kind, [n_views], papers, wanted.steps, until_s)
    table = pd.DataFrame([row for results in plants for row in results.rows])
    text = f"Means over all plants:\n\n{markdown(means(table))}"
    clustered = table[table["plant"].str.startswith("clustered")]
    if len(clustered):
        text += f"\nMeans over those with clustered tops:\n\n{markdown(means(clustered))}"
    write_text_atomically(wanted.folder / "segmentation.csv", table.to_csv(index=False))
    write_text_atomically(wanted.folder / "segmentation.md", text)
    print(f"\n{text}")


if __name__ == "__main__":
    main()
