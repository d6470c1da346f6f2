"""From masks to bolls: methods x number of views x quality of the masks, on plants whose bolls are known.

    python tests/accuracy/segmentation_sweep.py PLANT ... [--methods lift] [--views 12 24 36] [--masks exact degraded]

A PLANT is a folder where `cotton3dg run` is through, with `truth.json`, `cameras.json` and `instances/` in it or in the
folder given after a colon (RUN:TRUTH). Masks of the plant's images are made exact, degraded from these (15 % missed,
30 % of the pairs that touch in the image merged, 5 % split, edges 1 px off; the same in every run), or taken as the
`lint` back end made them. Every trial runs in a process of its own; nothing in the plants' folders changes.
Prints a row a trial and their means, and keeps the rows as --csv.

A boll counts as found when its centre is within 3 cm of a true one's; model and truth are laid over each other by their
cameras, so that neither table nor scale has a say.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import re
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from orbit_scene import degraded_masks

from cotton3dg.evaluate import MATCH_DISTANCE_CM
from cotton3dg.files.annotations import undistorted_ids
from cotton3dg.files.bolls import read_bolls
from cotton3dg.files.colmap import read_cameras
from cotton3dg.files.images import read_ids, write_ids
from cotton3dg.options import ClusterOptions, SegmentOptions
from cotton3dg.plant.match import match_bolls
from cotton3dg.plant.views import azimuths, evenly_spaced, fit_orbit
from cotton3dg.stages import cluster, segment
from cotton3dg.workspace import Workspace

METHODS = {"lift": "consensus", "probability": "consensus", "affinity": "dbscan"}
"""Method of segment -> of cluster."""
MASKS = ("exact", "degraded", "lint")


def masks_of(plant: Workspace, truth: Path, kind: str, n_views: int) -> dict[str, np.ndarray]:
    """Image name -> ids at the size of the undistorted image, of at most n_views views around the plant."""
    if kind == "lint":
        files = {path.with_suffix(".jpg").name: path for path in sorted(plant.folder("masks").glob("*.png"))}
    else:
        indices = _source_indices(plant)
        files = {name: truth / "instances" / f"frame_{index:04d}.png" for name, index in indices.items()}
    cameras = [camera for camera in read_cameras(plant.undistorted / "sparse") if _has(files, camera.name)]
    chosen = [cameras[k] for k in evenly_spaced(azimuths(cameras, fit_orbit(cameras)), n_views)]
    ids = {camera.name: read_ids(files[camera.name]) for camera in chosen}
    if kind != "lint":
        ids = {c.name: undistorted_ids(Path(c.name).stem, ids[c.name], c, plant.sfm_model) for c in chosen}
    if kind == "degraded":
        pairs = tuple(combinations(range(1, max(int(image.max()) for image in ids.values()) + 1), 2))
        rng = np.random.default_rng(0)
        ids = {name: degraded_masks(pairs, image, rng) for name, image in sorted(ids.items())}
    return ids


def _has(files: dict[str, Path], name: str) -> bool:
    return name in files and files[name].is_file()


def _source_indices(plant: Workspace) -> dict[str, int]:
    images = json.loads(plant.frames_json.read_text(encoding="utf-8"))["images"]
    return {image["name"]: image["source_index"] for image in images}


def with_masks(plant: Workspace, masks: dict[str, np.ndarray], folder: str) -> Workspace:
    """An empty folder made a plant's with other masks; its model is linked to."""
    scratch = Workspace(folder)
    for stage in ("sfm", "train"):
        scratch.folder(stage).symlink_to(plant.folder(stage).resolve())
    with scratch.writing("masks") as partial:
        for name, ids in masks.items():
            write_ids(partial / scratch.mask_png(name).name, ids)
    return scratch


def trial(folder: str, options: SegmentOptions) -> tuple[float, float]:
    """Processor time, s, and peak memory, MB, of segment and cluster in this process."""
    begin_s = time.process_time()
    segment.run(Workspace(folder), options)
    cluster.run(Workspace(folder), ClusterOptions(method=METHODS[options.method]))
    # Linux hands getrusage's maximum on to child processes, but not this one.
    peak = re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text(encoding="ascii"))
    return time.process_time() - begin_s, int(peak[1]) / 1024 if peak else math.nan


def cm_from_scene(plant: Workspace, truth: Path) -> np.ndarray:
    """(3, 4) similarity that lays the cameras over the true ones (Umeyama 1991)."""
    true_poses = {
        frame["frame"]: np.array(frame["camera_to_world"])[:3, 3]
        for frame in json.loads((truth / "cameras.json").read_text(encoding="utf-8"))["frames"]
    }
    indices = _source_indices(plant)
    cameras = [camera for camera in read_cameras(plant.undistorted / "sparse") if indices[camera.name] in true_poses]
    here = np.array([camera.centre for camera in cameras])
    there = 100 * np.array([true_poses[indices[camera.name]] for camera in cameras])
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    scale = (b * (a @ rotation.T)).sum() / (a * a).sum()
    return np.column_stack([scale * rotation, there.mean(axis=0) - scale * rotation @ here.mean(axis=0)])


def true_centres_cm(truth: Path) -> np.ndarray:
    bolls = json.loads((truth / "truth.json").read_text(encoding="utf-8"))["bolls"]
    return 100 * np.array([boll["centre_xyz_m"] for boll in bolls])


def scores(plant: Workspace, truth: Path, scratch: Workspace) -> dict[str, float]:
    """Count error, %, precision, recall and F1 of the bolls in a scratch folder."""
    affine = cm_from_scene(plant, truth)
    bolls, _ = read_bolls(scratch.bolls_json, scratch.labels_npy)
    found = np.array([boll.centre for boll in bolls]).reshape(-1, 3) @ affine[:, :3].T + affine[:, 3]
    true = true_centres_cm(truth)
    hits = len(match_bolls(found, true, MATCH_DISTANCE_CM))
    return {
        "true": len(true),
        "found": len(found),
        "count_pct": 100 * (len(found) / len(true) - 1),
        "precision": hits / max(len(found), 1),
        "recall": hits / len(true),
        "f1": 2 * hits / (len(found) + len(true)),
    }


def rows_of(plant: Workspace, truth: Path, wanted: argparse.Namespace) -> list[dict[str, float | str]]:
    """All trials of one plant, printed as they end."""
    rows: list[dict[str, float | str]] = []
    for kind in wanted.masks:
        for n_views in wanted.views:
            masks = masks_of(plant, truth, kind, n_views)
            if rows and (rows[-1]["masks"], rows[-1]["views"]) == (kind, len(masks)):
                continue  # the plant has no more views with masks
            with tempfile.TemporaryDirectory() as folder:
                scratch = with_masks(plant, masks, folder)
                for method in wanted.methods:
                    options = SegmentOptions(method=method, steps=wanted.steps)
                    context = multiprocessing.get_context("spawn")
                    with ProcessPoolExecutor(1, mp_context=context) as process:
                        cpu_s, peak_mb = process.submit(trial, folder, options).result()
                    trial_of = {"plant": plant.plant_id, "masks": kind, "views": len(masks), "method": method}
                    rows.append({**trial_of, **scores(plant, truth, scratch), "cpu_s": cpu_s, "peak_mb": peak_mb})
                    print(*(f"{v:.2f}" if isinstance(v, float) else v for v in rows[-1].values()), flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plants", nargs="+", metavar="PLANT")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--masks", nargs="+", choices=MASKS, default=list(MASKS))
    parser.add_argument("--views", nargs="+", type=int, default=[12, 24, 36])
    parser.add_argument("--steps", type=int, default=SegmentOptions.steps, help="of the method probability")
    parser.add_argument("--csv", type=Path)
    wanted = parser.parse_args()
    rows = []
    for plant in wanted.plants:
        run, _, truth = plant.partition(":")
        rows += rows_of(Workspace(run), Path(truth or run), wanted)
    table = pd.DataFrame(rows)
    if wanted.csv:
        table.to_csv(wanted.csv, index=False)
    table["count_pct"] = table["count_pct"].abs()
    means = table.drop(columns=["plant", "true", "found"]).groupby(["masks", "views", "method"]).mean()
    print("\nMeans, count error without sign:\n")
    print(means.to_string(float_format="{:.3f}".format))


if __name__ == "__main__":
    main()
