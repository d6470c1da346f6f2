# SPDX-License-Identifier: Apache-2.0
"""Which error is whose: plants measured again with true scale, true masks and true cameras put in place, one at a time.

    python tests/accuracy/error_budget.py FOLDER PLANT ... [--truths scale masks cameras all]

A PLANT is a folder where `cotton3dg run` is through, with `truth.json`, `cameras.json` and `instances/` in it or in the
folder given after a colon (RUN:TRUTH). For each truth the stages that depend on it run again, with the options of the
plant's own run, in a scratch folder that shares the other stages' files:

    scale     scale, plane and corners of the table as they are             traits
    masks     true instance masks, on as many images as the run had them    segment, cluster, traits
    cameras   true poses and lens, points triangulated with these           train and all after it
    all       the three together; what is left is the model's and the measuring's

Only `cameras` and `all` train a model (once for both). Each result is kept in FOLDER/PLANT.json as it is there and not
made again while the plant's model is the same. Prints, and keeps as FOLDER/error_budget.csv and .md, a row for each
plant and truth, and the mean absolute errors by truth.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markdown_tables import markdown
from segmentation_sweep import spread
from study_set import AIMS_PCT, judged, means
from true_scene import TruePlant, cm_from_scene, true_cameras, true_masks, true_plant, true_points, true_scale

from cotton3dg.core.runs import silent
from cotton3dg.io.colmap import read_cameras
from cotton3dg.io.images import write_ids
from cotton3dg.io.saving import file_sha256, json_text, write_text_atomically
from cotton3dg.recorded_options import recorded
from cotton3dg.schemas.scale import ScaleInfo
from cotton3dg.sfm.lens import undistort
from cotton3dg.stage import stage_of
from cotton3dg.workspace import Workspace

TRUTHS = ("scale", "masks", "cameras", "all")
MODEL = ("frames", "sfm", "train")
"""Stages that all share but those with true cameras."""


def run_stages(plant: TruePlant, scratch: Workspace, *stages: str) -> None:
    """Run stages in the scratch folder with the options that the plant's own run had."""
    for stage in stages:
        record = plant.run.read_record(stage)
        stage_of(stage).run(scratch, recorded(stage, record.options if record else {}), silent)


def share(plant: TruePlant, scratch: Workspace, *stages: str) -> None:
    for stage in stages:
        plant.run.share_result(stage, scratch)


def put_true_scale(plant: TruePlant, scratch: Workspace) -> None:
    with scratch.writing("scale") as folder:
        ScaleInfo.of_scale(true_scale(plant)).save(folder / scratch.scale_json.name)


def put_true_masks(plant: TruePlant, scratch: Workspace) -> None:
    n_views = len(list(plant.run.folder("masks").glob("*.png")))
    masks = true_masks(TruePlant(scratch, plant.truth), read_cameras(scratch.undistorted / "sparse"))
    with scratch.writing("masks") as folder:
        for name, ids in spread(scratch, masks, n_views).items():
            write_ids(folder / scratch.mask_png(name).name, ids)


def put_true_cameras(plant: TruePlant, scratch: Workspace) -> None:
    """The plant's sfm with true poses and lens, in its own unit of length and place; points where these see them."""
    import pycolmap

    model = pycolmap.Reconstruction(plant.run.sfm_model)
    poses, lens = true_cameras(plant)
    similarity = cm_from_scene(plant)
    cm_per_su = float(np.cbrt(np.linalg.det(similarity[:, :3])))
    ((camera_id, filmed),) = model.cameras.items()
    zoom = filmed.width / lens["width"]
    k1, k2 = lens["distortion"]["k1"], lens["distortion"]["k2"]
    model.cameras[camera_id] = pycolmap.Camera(
        camera_id=camera_id,
        model="RADIAL" if k2 else "SIMPLE_RADIAL",
        width=filmed.width,
        height=filmed.height,
        params=[zoom * lens["fx"], zoom * lens["cx"], zoom * lens["cy"], k1, *([k2] if k2 else [])],
    )
    for image_id in model.reg_image_ids():
        image = model.image(image_id)
        rotation, shift = poses[image.name][:, :3], poses[image.name][:, 3]
        pose = np.column_stack([rotation @ similarity[:, :3], rotation @ similarity[:, 3] + shift]) / cm_per_su
        model.frame(image.frame_id).rig_from_world = pycolmap.Rigid3d(pose)
    ids, _, true = true_points(plant)
    places = dict(zip(ids.tolist(), (true - similarity[:, 3]) @ similarity[:, :3] / cm_per_su**2, strict=True))
    for point in list(model.point3D_ids()):
        if point in places:
            model.points3D[point].xyz = places[point]
        else:
            model.delete_point3D(point)
    with scratch.writing("sfm") as folder:
        model.write_binary(folder)
        undistort(plant.run.folder("frames"), folder, folder / "undistorted")
        shutil.copyfile(plant.run.sfm_json, folder / scratch.sfm_json.name)


def measured_with(plant: TruePlant, truth: str, trained: Workspace) -> dict[str, Any]:
    """The plant's errors with one of `TRUTHS` in place. `trained` keeps the model of the true cameras from one to the
    next."""
    if truth in ("cameras", "all") and not trained.gaussians_ply.is_file():
        share(plant, trained, "frames")
        put_true_cameras(plant, trained)
        run_stages(plant, trained, "train")
    with tempfile.TemporaryDirectory(dir=trained.root) as folder:
        scratch = Workspace(folder)
        if truth in ("cameras", "all"):
            share(TruePlant(trained, plant.truth), scratch, *MODEL)
        else:
            share(plant, scratch, *MODEL)
        if truth in ("scale", "all"):
            put_true_scale(plant, scratch)
        elif truth == "cameras":
            run_stages(plant, scratch, "scale")
        else:
            share(plant, scratch, "scale")
        if truth in ("masks", "all"):
            put_true_masks(plant, scratch)
            run_stages(plant, scratch, "segment", "cluster")
        elif truth == "cameras":
            run_stages(plant, scratch, "masks", "segment", "cluster")
        else:
            share(plant, scratch, "masks", "segment", "cluster")
        run_stages(plant, scratch, "traits")
        return judged(TruePlant(scratch, plant.truth))


def budget(plant: TruePlant, kept: Path, truths: Sequence[str]) -> list[dict[str, Any]]:
    """The rows of one plant; those that `kept` has of the same model are taken from it, others added to it."""
    model = file_sha256(plant.run.gaussians_ply)
    rows = json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else []
    rows = [row for row in rows if row["model"] == model]
    with tempfile.TemporaryDirectory(dir=kept.parent) as folder:
        trained = Workspace(folder)
        for truth in ("none", *truths):
            if any(row["truth"] == truth for row in rows):
                continue
            found = judged(plant) if truth == "none" else measured_with(plant, truth, trained)
            rows.append({**found, "plant": plant.run.plant_id, "truth": truth, "model": model})
            write_text_atomically(kept, json_text(rows))
            print(plant.run.plant_id, truth, *(f"{name} {found[name]:.2f}" for name in AIMS_PCT), flush=True)
    return [row for row in rows if row["truth"] in ("none", *truths)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("plants", nargs="+", type=true_plant, metavar="PLANT")
    parser.add_argument("--truths", nargs="+", choices=TRUTHS, default=list(TRUTHS))
    wanted = parser.parse_args()
    wanted.folder.mkdir(parents=True, exist_ok=True)
    kept = [(plant, wanted.folder / f"{plant.run.plant_id}.json") for plant in wanted.plants]
    rows = pd.DataFrame([row for plant, file in kept for row in budget(plant, file, wanted.truths)])
    by_truth = [{"truth": truth, **means(of_truth)} for truth, of_truth in rows.groupby("truth", sort=False)]
    shown = ["truth", "plants", *AIMS_PCT, "f1"]
    each = rows[["plant", "truth", "bolls", "found", "false", *AIMS_PCT]]
    text = (
        "Mean absolute errors, %, with what is true in place (one_boll: median over all bolls found):\n\n"
        f"{markdown(pd.DataFrame([*by_truth, {'truth': 'aim, at most', **AIMS_PCT}])[shown])}\n"
        f"Errors, %, of each plant:\n\n{markdown(each)}"
    )
    write_text_atomically(wanted.folder / "error_budget.csv", each.to_csv(index=False))
    write_text_atomically(wanted.folder / "error_budget.md", text)
    print(f"\n{text}")


if __name__ == "__main__":
    main()
